// Empties pictures.

layout(local_size_x = 256) in;

uniform uint n_words;

void main() {
    uint step = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint i = gl_GlobalInvocationID.x; i < n_words; i += step) pictures[i] = (i & 1u) == 0u ? 0u : NO_FACE;
}
