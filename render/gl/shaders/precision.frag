layout(location = 0) out vec4 bits;  // of 255
void main() { bits = vec4(mantissaBits() / 255.0); }
