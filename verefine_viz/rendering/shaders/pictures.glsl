#version 430
// What the passes share: N combinations of poses, of n_models models each, and the picture of each combination's window.

const uint NO_FACE = 0xffffffffu;

// Of each combination: its window (x0, y0, columns, rows) [px]; the first pixel of its picture; then of each model three
// rows of [R|t], and whether it lies in front of the near plane as a whole, its first face, and how many it has, 0 where
// it is not drawn.
layout(std430, binding = 0) readonly buffer Combinations { vec4 combinations[]; };
// Of each pixel: the bits of 1/z, 0 = empty (floats above 0 order as their bits do: larger is nearer); the face seen there.
layout(std430, binding = 1) buffer Pictures { uint pictures[]; };

uniform int n_models;

uint combination_at(uint i) { return i * uint(2 + 4 * n_models); }
ivec4 window_of(uint i) { return ivec4(combinations[combination_at(i)]); }
uint first_pixel_of(uint i) { return uint(combinations[combination_at(i) + 1u].x); }
uint pose_at(uint i, int model) { return combination_at(i) + 2u + 4u * uint(model); }
