layout(location = 0) out float depth_m;
in vec2 uv;
void main() { depth_m = depthAt(ivec2(gl_FragCoord.xy)); }
