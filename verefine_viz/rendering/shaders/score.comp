// Pass 3: Eq. 1 and the pixel classes, summed over each combination's window by a work group.
// The same rules as score_kernels.py, which has the comments.

const int PUBLISHED = 0, OBSERVED = 1, CLASSES = 2;

layout(std430, binding = 5) readonly buffer Normals { vec4 normals[]; };  // of each face, object frame, and its model
layout(std430, binding = 6) readonly buffer PlacedPicture { uint placed[]; };  // the objects placed before, whole frame

uniform bool has_placed;
uniform int pixels;
uniform float tau_m;
uniform float alpha;

vec4 fits = vec4(0.0);     // Σ f_d, Σ f_n, rendered, rendered outside all objects
vec4 classes = vec4(0.0);  // explained, behind in any mask, protruding, hidden
vec4 rest = vec4(0.0);     // unknown, rendered in any mask

float placed_z(int pixel) {
    float inv_z = has_placed ? uintBitsToFloat(placed[2 * pixel]) : 0.0;
    return inv_z > 0.0 ? 1.0 / inv_z : 0.0;
}

int held = -1;  // the model whose rotation is at hand
mat3 to_model;

vec3 facing(uint i, int model, vec3 normal, ivec2 at) {
    if (model != held) {
        uint pose = pose_at(i, model);
        held = model;
        to_model = mat3(combinations[pose].xyz, combinations[pose + 1u].xyz, combinations[pose + 2u].xyz);
    }
    vec3 n = normal * to_model;
    vec3 ray = vec3((vec2(at) - camera.zw) / camera.xy, 1.0);
    return dot(n, ray) > 0.0 ? -n : n;
}

void add(uint i, ivec2 at, float z, uint face) {
    int pixel = at.y * width + at.x;
    vec4 measured = observed[pixel], normal = normals[face];
    uint flag = flags_at(0, pixel);
    int model = int(normal.w);
    float d = measured.w;
    bool any_own = (flag & OWN) != 0u, objects = (flag & OBJECTS) != 0u;
    bool near = d > 0.0 && abs(d - z) < tau_m;
    bool explained = near && (flags_at(1 + model, pixel) & OWN) != 0u;

    fits.z += 1.0;
    if (!objects) fits.w += 1.0;
    if (any_own) rest.y += 1.0;
    if (d == 0.0) rest.x += 1.0;
    else if (explained) classes.x += 1.0;
    else if (!near && d > z) classes.z += 1.0;
    else {
        float other = placed_z(pixel);
        if (other > 0.0 && other < z && abs(d - other) < tau_m) classes.w += 1.0;
        else if (near) classes.z += 1.0;
        else if (any_own) classes.y += 1.0;
        else classes.w += 1.0;
    }

    if (!(pixels == PUBLISHED ? objects : pixels == OBSERVED ? any_own : explained)) return;
    // Eq. 1: f_d = max(0, 1 − |d − d̂| / τ).
    float f_d = max(0.0, 1.0 - abs(d - z) / tau_m);
    fits.x += f_d;
    if (pixels != PUBLISHED && measured.xyz == vec3(0.0)) {
        fits.y += f_d;
        return;
    }
    float cosine = dot(measured.xyz, facing(i, model, normal.xyz, at));
    // Eq. 1: f_n = max(0, 1 − (1 − n·n̂) / α).
    fits.y += max(0.0, 1.0 - (1.0 - clamp(cosine, 0.0, 1.0)) / alpha);
}

void main() {
    uint i = gl_WorkGroupID.x, first = first_pixel_of(i);
    ivec4 window = window_of(i);
    for (int k = int(gl_LocalInvocationID.x); k < window.z * window.w; k += int(gl_WorkGroupSize.x)) {
        uint at = 2u * (first + uint(k)), bits = pictures[at], face = pictures[at + 1u];
        if (bits == 0u || face == NO_FACE) continue;
        add(i, window.xy + ivec2(k % window.z, k / window.z), 1.0 / uintBitsToFloat(bits), face);
    }
    store_sums(i, fits, classes, rest);
}
