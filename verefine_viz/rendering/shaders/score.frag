#version 330
// Pass 2: Eq. 1 and the pixel classes, summed along one row of one combination's tile. Fragment (x, y): row x of
// combination y, which has one pose of each of n_models models.
// The same rules as score_kernels.py, which has the comments.

const int PUBLISHED = 0, OBSERVED = 1, CLASSES = 2;
const uint OWN = 1u, OBJECTS = 2u;

uniform sampler2D atlas;         // z [m], face
uniform sampler2D poses;         // row i: three rows of [R|t] of each model, then (x0, y0, columns, rows) of the window
uniform sampler2D face_normals;  // object frame, and the model's number; filled row by row
uniform sampler2D observed;      // normal, z [m]
uniform usampler2D flags;
uniform usampler2DArray own;     // layer k: whether a pixel is in the mask of model k
uniform sampler2D placed;        // z [m] of the objects placed before
uniform bool has_placed;
uniform vec4 camera;             // fx, fy, cx, cy [px]
uniform ivec2 tile;              // columns, rows [px]
uniform int tiles_per_row;
uniform int n_models;
uniform int pixels;
uniform float tau_m;
uniform float alpha;

layout(location = 0) out vec4 fits;     // Σ f_d, Σ f_n, rendered, rendered outside all objects
layout(location = 1) out vec4 classes;  // explained, behind in any mask, protruding, hidden
layout(location = 2) out vec4 rest;     // unknown, rendered in any mask

void main() {
    int row = int(gl_FragCoord.x), pose = int(gl_FragCoord.y);
    fits = classes = rest = vec4(0.0);
    ivec4 window = ivec4(texelFetch(poses, ivec2(3 * n_models, pose), 0));
    if (row >= window.w) return;
    ivec2 corner = ivec2(pose % tiles_per_row, pose / tiles_per_row) * tile;
    int normals_width = textureSize(face_normals, 0).x;

    for (int x = 0; x < window.z; ++x) {
        vec2 surface = texelFetch(atlas, corner + ivec2(x, row), 0).xy;
        float z = surface.x;
        if (z == 0.0) continue;
        ivec2 pixel = window.xy + ivec2(x, row);
        vec4 measured = texelFetch(observed, pixel, 0);
        uint flag = texelFetch(flags, pixel, 0).r;
        float d = measured.w;
        bool any_own = (flag & OWN) != 0u, objects = (flag & OBJECTS) != 0u;
        bool near = d > 0.0 && abs(d - z) < tau_m;
        int face = int(surface.y);
        vec4 face_normal = texelFetch(face_normals, ivec2(face % normals_width, face / normals_width), 0);
        int model = int(face_normal.w);
        bool explained = near && texelFetch(own, ivec3(pixel, model), 0).r != 0u;

        fits.z += 1.0;
        if (!objects) fits.w += 1.0;
        if (any_own) rest.y += 1.0;
        if (d == 0.0) rest.x += 1.0;
        else if (explained) classes.x += 1.0;
        else if (!near && d > z) classes.z += 1.0;
        else {
            float other = has_placed ? texelFetch(placed, pixel, 0).x : 0.0;
            if (other > 0.0 && other < z && abs(d - other) < tau_m) classes.w += 1.0;
            else if (near) classes.z += 1.0;
            else if (any_own) classes.y += 1.0;
            else classes.w += 1.0;
        }

        if (!(pixels == PUBLISHED ? objects : pixels == OBSERVED ? any_own : explained)) continue;
        // Eq. 1: f_d = max(0, 1 − |d − d̂| / τ).
        float f_d = max(0.0, 1.0 - abs(d - z) / tau_m);
        fits.x += f_d;
        if (pixels != PUBLISHED && measured.xyz == vec3(0.0)) {
            fits.y += f_d;
            continue;
        }
        mat3 R = transpose(mat3(
            texelFetch(poses, ivec2(3 * model, pose), 0).xyz,
            texelFetch(poses, ivec2(3 * model + 1, pose), 0).xyz,
            texelFetch(poses, ivec2(3 * model + 2, pose), 0).xyz));
        vec3 n = R * face_normal.xyz;
        vec3 ray = vec3((vec2(pixel) - camera.zw) / camera.xy, 1.0);
        float cosine = dot(measured.xyz, dot(n, ray) > 0.0 ? -n : n);
        // Eq. 1: f_n = max(0, 1 − (1 − n·n̂) / α).
        fits.y += max(0.0, 1.0 - (1.0 - clamp(cosine, 0.0, 1.0)) / alpha);
    }
}
