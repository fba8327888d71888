// Squares of SIZE texels as points: what is drawn when not all texels of a target are wanted. A point has no
// diagonal, along which a square of two triangles would be worked on twice.
layout(location = 0) in vec2 centre;  // texels
uniform float side;                   // texels of the target

void main() {
  gl_Position = vec4(centre * (2.0 / side) - 1.0, 0.0, 1.0);
  gl_PointSize = SIZE;
}
