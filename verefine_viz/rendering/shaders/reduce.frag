#version 330
// Pass 3: the rows of each pose, summed. Fragment (x, y): output y of pass 2, pose x.

uniform sampler2D rows_0;
uniform sampler2D rows_1;
uniform sampler2D rows_2;
uniform int n_rows;

out vec4 sum;

void main() {
    int pose = int(gl_FragCoord.x), k = int(gl_FragCoord.y);
    sum = vec4(0.0);
    for (int row = 0; row < n_rows; ++row) {
        ivec2 at = ivec2(row, pose);
        sum += k == 0 ? texelFetch(rows_0, at, 0) : k == 1 ? texelFetch(rows_1, at, 0) : texelFetch(rows_2, at, 0);
    }
}
