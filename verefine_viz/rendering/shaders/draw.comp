// Passes 1 and 2: a thread, or several, for each combination, model and triangle. First the nearest 1/z of every pixel, then the
// first of the faces that are so near. The same rules as rasterizer.py: a pixel is covered where its centre lies in the
// triangle, edges included.
//
// "precise" where a number decides: both passes, and both triangles of an edge, must get the same bits.

layout(local_size_x = 128) in;

layout(std430, binding = 2) readonly buffer Vertices { vec4 vertices[]; };
layout(std430, binding = 3) readonly buffer Faces { ivec4 faces[]; };  // corners; whether its surface is closed

uniform bool find_faces;    // pass 2
uniform int side;           // side² threads for each triangle, which share its pixels like tiles of a floor
uniform vec4 camera;        // fx, fy, cx, cy [px]
uniform float near_m;
uniform float least_inv_z;  // of the farthest surface that is drawn [1/m]

vec3 projected(vec3 p) {
    precise float inv_z = 1.0 / p.z;
    precise vec2 uv = p.xy * inv_z * camera.xy + camera.zw;
    return vec3(uv, inv_z);
}

// Twice the signed area of a, b and p; exactly the negative where a and b change places.
float across(vec2 a, vec2 b, vec2 p) {
    precise vec2 to_a = a - p, to_b = b - p;
    precise float area = to_a.x * to_b.y - to_a.y * to_b.x;
    return area;
}

// Draws a projected triangle into a picture that begins at pixel `base`; with only_front not if its back is seen.
void fill(ivec4 window, uint base, uint face, ivec2 lane, vec3 a, vec3 b, vec3 c, bool only_front) {
    float area = across(b.xy, c.xy, a.xy);
    if (area == 0.0 || (only_front && area > 0.0)) return;
    float turn = area > 0.0 ? 1.0 : -1.0;
    // Within the window as floats, which become whole numbers only then, and once more: no index leaves its picture.
    ivec2 low = window.xy, high = window.xy + window.zw - 1;
    ivec2 first = ivec2(clamp(ceil(min(a.xy, min(b.xy, c.xy))), vec2(low), vec2(high + 1)));
    ivec2 last = ivec2(clamp(floor(max(a.xy, max(b.xy, c.xy))), vec2(low - 1), vec2(high)));
    first = max(first, low);
    last = min(last, high);
    float nearest = max(a.z, max(b.z, c.z)), farthest = min(a.z, min(b.z, c.z));
    for (int y = first.y + lane.y; y <= last.y; y += side) {
        for (int x = first.x + lane.x; x <= last.x; x += side) {
            vec2 p = vec2(x, y);
            precise vec3 part = turn * vec3(across(b.xy, c.xy, p), across(c.xy, a.xy, p), across(a.xy, b.xy, p));
            precise float whole = part.x + part.y + part.z;
            if (min(part.x, min(part.y, part.z)) < 0.0 || !(whole > 0.0)) continue;
            precise float inv_z = (part.x * a.z + part.y * b.z + part.z * c.z) / whole;
            inv_z = clamp(inv_z, farthest, nearest);
            if (inv_z < least_inv_z) continue;
            uint at = 2u * (base + uint((y - low.y) * window.z + x - low.x)), bits = floatBitsToUint(inv_z);
            uint before = pictures[at];
            if (find_faces) {
                if (before == bits) atomicMin(pictures[at + 1u], face);
            } else if (before < bits) {
                atomicMax(pictures[at], bits);
            }
        }
    }
}

// Where an edge meets the near plane, from whichever end.
vec3 crossing(vec3 p, vec3 q) {
    vec3 behind = p.z < q.z ? p : q, before = p.z < q.z ? q : p;
    precise float along = (near_m - behind.z) / (before.z - behind.z);
    precise vec2 xy = behind.xy + along * (before.xy - behind.xy);
    return vec3(xy, near_m);
}

vec3 placed(vec4 r0, vec4 r1, vec4 r2, int corner) {
    vec3 p = vertices[corner].xyz;
    precise float x = r0.x * p.x + r0.y * p.y + r0.z * p.z + r0.w;
    precise float y = r1.x * p.x + r1.y * p.y + r1.z * p.z + r1.w;
    precise float z = r2.x * p.x + r2.y * p.y + r2.z * p.z + r2.w;
    return vec3(x, y, z);
}

void main() {
    uint i = gl_WorkGroupID.y, pose = pose_at(i, int(gl_WorkGroupID.z)), base = first_pixel_of(i);
    ivec4 window = window_of(i);
    vec4 r0 = combinations[pose], r1 = combinations[pose + 1u], r2 = combinations[pose + 2u];
    vec4 model = combinations[pose + 3u];
    uint first_face = uint(model.y), lanes = uint(side * side), n = uint(model.z) * lanes;
    for (uint k = gl_GlobalInvocationID.x; k < n; k += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint face = first_face + k / lanes;
        ivec2 lane = ivec2(k % lanes % uint(side), k % lanes / uint(side));
        ivec4 corners = faces[face];
        vec3 a = placed(r0, r1, r2, corners.x), b = placed(r0, r1, r2, corners.y), c = placed(r0, r1, r2, corners.z);
        vec3 d = c;
        bvec3 front = greaterThanEqual(vec3(a.z, b.z, c.z), vec3(near_m));
        int n_front = int(front.x) + int(front.y) + int(front.z);
        if (n_front == 0) continue;
        if (n_front < 3) {
            // The corner that is alone, in front or behind, comes first; what is left is a triangle, or abc and acd.
            bool alone = n_front == 1;
            if (front.y == alone) { vec3 swap = a; a = b; b = c; c = swap; }
            else if (front.z == alone) { vec3 swap = c; c = b; b = a; a = swap; }
            vec3 ab = crossing(a, b), ac = crossing(a, c);
            if (alone) { b = ab; c = ac; }
            else { a = ab; d = ac; }
        }
        // The back of a closed surface is never seen, unless the near plane opens it.
        bool only_front = corners.w != 0 && model.x != 0.0;
        for (int part = 0; part < (n_front == 2 ? 2 : 1); ++part) {
            fill(window, base, face, lane, projected(a), projected(b), projected(c), only_front);
            b = c;
            c = d;
        }
    }
}
