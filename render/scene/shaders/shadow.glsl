// Vertex stages of the shadow map: the scene as the sun sees it, orthographic.
uniform mat3 light_from_scene_rotation;
uniform vec3 light_ndc_scale;
uniform vec3 light_ndc_offset;
vec4 lightClipOf(vec3 p) { return vec4(light_ndc_scale * (light_from_scene_rotation * p) + light_ndc_offset, 1.0); }
