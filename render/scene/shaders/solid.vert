layout(location = 0) in vec3 position;
layout(location = 1) in vec3 vertex_normal;
layout(location = 2) in vec2 vertex_uv;
layout(location = 3) in uint vertex_surface;
out vec3 place;
out vec2 at;
flat out vec3 normal;
flat out uint surface;
void main() {
  place = position;
  at = vertex_uv;
  normal = vertex_normal;
  surface = vertex_surface;
  gl_Position = clipOf(cameraFromScene(position));
}
