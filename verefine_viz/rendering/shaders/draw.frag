#version 330
// Pass 1: which surface a pixel sees. z = 0 is empty.

uniform float far_m;
uniform int first_face;  // of this model among all that share the picture

in float z_m;
out vec2 surface;  // z [m], face index

void main() {
    if (z_m > far_m) discard;
    surface = vec2(z_m, float(first_face + gl_PrimitiveID));
}
