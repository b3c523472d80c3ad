#version 330
// A model under one pose into its tile of the atlas.

uniform mat4 T_cam_obj;
uniform mat4 projection;

in vec3 in_position;
out float z_m;

void main() {
    vec4 p_cam = T_cam_obj * vec4(in_position, 1.0);
    z_m = p_cam.z;
    gl_Position = projection * p_cam;
}
