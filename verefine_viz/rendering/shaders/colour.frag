#version 330
// What f_c of one model is made of, summed along one row of one combination's tile, over its explained pixels.
// Fragment (x, y): row x of combination y. The same rules as _sum_colours in score_kernels.py.

uniform sampler2D atlas;         // z [m], face
uniform sampler2D poses;         // as in score.frag
uniform sampler2D face_normals;  // the model's number in w; filled row by row
uniform sampler2D observed;      // normal, z [m]
uniform usampler2DArray own;     // layer k: whether a pixel is in the mask of model k
uniform sampler2D image;         // the smoothed image, opponent space
uniform sampler3D cells;         // the model's colours; the cell (x, y, z) is texel (z, y, x)
uniform vec3 origin_m;           // corner of the first cell, object frame
uniform float per_metre;         // cells
uniform vec4 camera;             // fx, fy, cx, cy [px]
uniform ivec2 tile;              // columns, rows [px]
uniform int tiles_per_row;
uniform int n_models;
uniform int model;               // whose colours are summed
uniform float tau_m;

layout(location = 0) out vec4 first;   // pixels, Σa
layout(location = 1) out vec4 second;  // Σb, Σa²
layout(location = 2) out vec4 third;   // Σb², Σab

void main() {
    int row = int(gl_FragCoord.x), pose = int(gl_FragCoord.y);
    first = second = third = vec4(0.0);
    ivec4 window = ivec4(texelFetch(poses, ivec2(3 * n_models, pose), 0));
    if (row >= window.w) return;
    ivec2 corner = ivec2(pose % tiles_per_row, pose / tiles_per_row) * tile;
    int normals_width = textureSize(face_normals, 0).x;
    ivec3 last = textureSize(cells, 0).zyx - 1;
    // Rows of [R|t], hence columns of the transpose.
    vec4 r0 = texelFetch(poses, ivec2(3 * model, pose), 0);
    vec4 r1 = texelFetch(poses, ivec2(3 * model + 1, pose), 0);
    vec4 r2 = texelFetch(poses, ivec2(3 * model + 2, pose), 0);

    for (int x = 0; x < window.z; ++x) {
        vec2 surface = texelFetch(atlas, corner + ivec2(x, row), 0).xy;
        float z = surface.x;
        if (z == 0.0) continue;
        ivec2 pixel = window.xy + ivec2(x, row);
        if (((pixel.x + pixel.y) & 1) != 0) continue;
        float d = texelFetch(observed, pixel, 0).w;
        if (d == 0.0 || abs(d - z) >= tau_m) continue;
        int face = int(surface.y);
        if (int(texelFetch(face_normals, ivec2(face % normals_width, face / normals_width), 0).w) != model) continue;
        if (texelFetch(own, ivec3(pixel, model), 0).r == 0u) continue;
        vec3 p = vec3((vec2(pixel) - camera.zw) / camera.xy * z, z) - vec3(r0.w, r1.w, r2.w);
        vec3 along = (p.x * r0.xyz + p.y * r1.xyz + p.z * r2.xyz - origin_m) * per_metre;
        ivec3 cell = clamp(ivec3(floor(along)), ivec3(0), last);
        vec3 a = texelFetch(cells, cell.zyx, 0).rgb, b = texelFetch(image, pixel, 0).rgb;
        first += vec4(1.0, a);
        second += vec4(b, dot(a, a));
        third += vec4(dot(b, b), dot(a, b), 0.0, 0.0);
    }
}
