layout(location = 0) in vec3 position;
layout(location = 1) in vec3 vertex_normal;
out vec3 place;
out vec3 normal;
void main() {
  place = position;
  normal = vertex_normal;
  gl_Position = clipOf(cameraFromScene(position));
}
