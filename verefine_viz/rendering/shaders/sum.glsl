// The end of a pass that sums: what the threads of a work group found, added up in one order.

layout(local_size_x = 512) in;

layout(std430, binding = 2) writeonly buffer Sums { vec4 sums[]; };

shared vec4 parts[3][gl_WorkGroupSize.x];

void store_sums(uint at, vec4 first, vec4 second, vec4 third) {
    uint me = gl_LocalInvocationID.x;
    parts[0][me] = first;
    parts[1][me] = second;
    parts[2][me] = third;
    barrier();
    for (uint half_of = gl_WorkGroupSize.x / 2u; half_of > 0u; half_of /= 2u) {
        if (me < half_of) {
            for (int k = 0; k < 3; ++k) parts[k][me] += parts[k][me + half_of];
        }
        barrier();
    }
    if (me < 3u) sums[3u * at + me] = parts[me][0];
}

// The observed frame: normal and z [m]; flags, four to a word: those of all masks, then those of each model's.
layout(std430, binding = 3) readonly buffer Observed { vec4 observed[]; };
layout(std430, binding = 4) readonly buffer Flags { uint flags[]; };

const uint OWN = 1u, OBJECTS = 2u;

uniform vec4 camera;     // fx, fy, cx, cy [px]
uniform int width;       // of the frame [px]
uniform int n_pixels;    // of the frame

uint flags_at(int layer, int pixel) {
    int k = layer * n_pixels + pixel;
    return (flags[k >> 2] >> (8 * (k & 3))) & 255u;
}
