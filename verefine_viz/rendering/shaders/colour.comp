// Pass 4: what f_c of each model is made of, summed over its explained pixels in each combination's window by a work
// group. The same rules as _sum_colours in score_kernels.py.

struct Grid {
    vec4 corner;   // of the first cell [m], object frame, and cells per metre
    ivec4 shape;   // in cells, and the model's first cell; no cells = no colours
    ivec2 faces;   // of the model: the first, and that after the last
};

layout(std430, binding = 5) readonly buffer Image { float image[]; };  // smoothed, opponent space
layout(std430, binding = 6) readonly buffer Cells { float cells[]; };  // the models' colours
layout(std430, binding = 7) readonly buffer Grids { Grid grids[]; };

uniform float tau_m;

void main() {
    uint i = gl_WorkGroupID.x, first_pixel = first_pixel_of(i);
    int model = int(gl_WorkGroupID.y);
    Grid grid = grids[model];
    ivec4 window = window_of(i);
    // Rows of [R|t], hence columns of the transpose.
    uint pose = pose_at(i, model);
    vec4 r0 = combinations[pose], r1 = combinations[pose + 1u], r2 = combinations[pose + 2u];
    vec4 first = vec4(0.0), second = vec4(0.0), third = vec4(0.0);  // pixels, Σa; Σb, Σa²; Σb², Σab
    int n = grid.shape.x > 0 ? window.z * window.w : 0;

    for (int k = int(gl_LocalInvocationID.x); k < n; k += int(gl_WorkGroupSize.x)) {
        ivec2 at = window.xy + ivec2(k % window.z, k / window.z);
        uint word = 2u * (first_pixel + uint(k)), bits = pictures[word];
        if (((at.x + at.y) & 1) != 0 || bits == 0u) continue;
        int face = int(pictures[word + 1u]), pixel = at.y * width + at.x;
        if (face < grid.faces.x || face >= grid.faces.y) continue;
        float z = 1.0 / uintBitsToFloat(bits), d = observed[pixel].w;
        if (d == 0.0 || abs(d - z) >= tau_m || (flags_at(1 + model, pixel) & OWN) == 0u) continue;
        vec3 p = vec3((vec2(at) - camera.zw) / camera.xy * z, z) - vec3(r0.w, r1.w, r2.w);
        vec3 along = (p.x * r0.xyz + p.y * r1.xyz + p.z * r2.xyz - grid.corner.xyz) * grid.corner.w;
        ivec3 cell = clamp(ivec3(floor(along)), ivec3(0), grid.shape.xyz - 1);
        int c = 3 * (grid.shape.w + (cell.x * grid.shape.y + cell.y) * grid.shape.z + cell.z);
        vec3 a = vec3(cells[c], cells[c + 1], cells[c + 2]);
        vec3 b = vec3(image[3 * pixel], image[3 * pixel + 1], image[3 * pixel + 2]);
        first += vec4(1.0, a);
        second += vec4(b, dot(a, a));
        third += vec4(dot(b, b), dot(a, b), 0.0, 0.0);
    }
    store_sums(i * uint(n_models) + uint(model), first, second, third);
}
