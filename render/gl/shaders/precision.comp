layout(local_size_x = 1) in;
layout(std430, binding = 0) writeonly buffer Result { float bits; };
void main() { bits = mantissaBits(); }
