// Vertex stages: from the scene's frame into the picture. Row 0 of the picture is row 0 of memory.
uniform mat3 camera_from_scene_rotation;
uniform vec3 camera_in_scene;
uniform vec4 projection;     // x_ndc = projection.x * X/Z + projection.z, y_ndc = .y * Y/Z + .w
uniform vec2 depth_range;    // z_ndc = depth_range.x + depth_range.y / Z
#ifdef ROLLING_SHUTTER
uniform vec3 velocity;       // of the camera, in its axes, metres per second
uniform vec3 rotation;       // of the camera, in its axes, radians per second
uniform vec2 row_time;       // seconds after the middle row = row_time.x * y_ndc_of_the_sensor
uniform float sensor_rows;   // y_ndc on the sensor = this times y_ndc in the picture (wider than the sensor)
#ifdef LENS_DISTORTION
uniform float distortion[5];
uniform vec2 sensor_projection;  // y_ndc on the sensor = .x * (distorted Y/Z) + .y
float sensorRow(vec3 p) {
  vec2 q = p.xy / p.z;
  float r2 = dot(q, q);
  float radial = 1.0 + r2 * (distortion[0] + r2 * (distortion[1] + r2 * distortion[4]));
  return sensor_projection.x * (q.y * radial + distortion[2] * (r2 + 2.0 * q.y * q.y) + 2.0 * distortion[3] * q.x * q.y) + sensor_projection.y;
}
#else
float sensorRow(vec3 p) { return projection.y * p.y / p.z + projection.w; }
#endif
#endif

vec4 clipOf(vec3 p_in_camera) {
  return vec4(projection.x * p_in_camera.x + projection.z * p_in_camera.z,
              projection.y * p_in_camera.y + projection.w * p_in_camera.z,
              depth_range.x * p_in_camera.z + depth_range.y, p_in_camera.z);
}

// A point as its own row sees it. With a rolling shutter the camera has moved on by the time the row is
// exposed; the row in turn depends on that move: two steps of the fixed point are enough for drones.
vec3 cameraFromScene(vec3 p) {
  vec3 at_middle = camera_from_scene_rotation * (p - camera_in_scene);
#ifdef ROLLING_SHUTTER
  vec3 seen = at_middle;
  if (at_middle.z > 0.1) {
    for (int i = 0; i < 3; ++i) {
      float t = row_time.x * clamp(sensorRow(seen), -1.5, 1.5);
      vec3 moved = at_middle - t * velocity;
      // Rotation by -t * rotation, to second order.
      vec3 w = -t * rotation;
      seen = moved + cross(w, moved) + 0.5 * cross(w, cross(w, moved));
    }
  }
  return seen;
#else
  return at_middle;
#endif
}
