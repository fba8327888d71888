// What every pass over a picture shares. Pictures hold encoded values (response.glsl: a square root).
in vec2 uv;
uniform sampler2D picture;
layout(location = 0) out vec4 color;
vec3 linearOf(vec3 e) { return e * e; }
vec3 encodedOf(vec3 l) { return sqrt(clamp(l, 0.0, 1.0)); }
ivec2 pixel() { return ivec2(gl_FragCoord.xy); }
vec3 here() { return texelFetch(picture, pixel(), 0).rgb; }
