#version 330
// Pass 1: which surface a pixel sees. z = 0 is empty.

uniform float far_m;

in float z_m;
out vec2 surface;  // z [m], face index

void main() {
    if (z_m > far_m) discard;
    surface = vec2(z_m, float(gl_PrimitiveID));
}
