in vec2 uv;
layout(location = 0) out vec4 result;
void main() { result = vec4(walk(ivec2(gl_FragCoord.xy)) * (1.0 / float(READS))); }
