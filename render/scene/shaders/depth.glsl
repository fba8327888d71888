// Depth of the first sample of each pixel, and the ray through the pixel's centre.
uniform highp sampler2DMS depth_samples;
uniform vec2 depth_range;   // as in camera.glsl
uniform vec4 lens;          // fx, fy, cx, cy in pixels
float depthAt(ivec2 p) { return depth_range.y / (2.0 * texelFetch(depth_samples, p, 0).r - 1.0 - depth_range.x); }
vec3 rayAt(vec2 p) { return vec3((p - lens.zw) / lens.xy, 1.0); }
