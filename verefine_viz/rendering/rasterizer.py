"""Triangles to a z-buffer, on the CPU (numba).

Pixel (row v, column u) is covered where its centre, the point (u, v) itself, lies in the projected triangle, edges
included. 1/z is linear over the image, so the buffer holds 1/z: 0 is empty, larger is nearer. Both faces are drawn.
Triangles that cross the plane z = ``NEAR_M`` are clipped there; what lies behind it is dropped.

Whatever camera, pose and mesh are given, infinities and NaN among them, no index leaves its array: a number is brought
within bounds before it becomes one, as what becomes of a float that no integer holds is not defined.
"""

from __future__ import annotations

import numpy as np

from verefine_viz.core.kernels import kernel

NEAR_M = 0.01
"""Nearest surface that is drawn [m], as in the authors' renderer."""

EDGE_PX = 1e-7
"""How far outside its triangle a pixel centre may lie [px]: rounding must not open holes along shared edges."""

UNBOUNDED_PX = 1e30
"""Stands for no bound on a row."""

BLOCK_BITS = 3
BLOCK_PX = 1 << BLOCK_BITS
"""Side of the blocks of the coarse depth grid [px]; a matter of speed only."""

FAR_AWAY_M = 1e6
"""A pose with a number larger than this is not drawn [m]."""

# Kernels of others call these with arrays that can be written to (``core.arrays.writable``) and with ``np.int64(0)``: a
# read-only array and a bare 0 are types of their own to numba, for which it compiles everything once more.


@kernel()
def is_drawable(T):  # noqa: D103
    for i in range(3):
        for j in range(4):
            if not np.isfinite(T[i, j]) or abs(T[i, j]) > FAR_AWAY_M:
                return False
    return True


@kernel()
def clamped(x, low, high):
    """A float as a whole number from ``low`` to ``high``; ``low`` where it is NaN."""
    return int(min(max(low, x), high))  # In this order: NaN is not larger than ``low``.


@kernel()
def project(T, vertices, fx, fy, cx, cy, projected):
    """Fills ``projected`` (V, 3) with (u, v, 1/z), or (-, -, 0) in front of the near plane.

    Returns:
        The box of the vertices in front, (u min, v min, u max, v max), and how many those are.
    """
    u_min, v_min, u_max, v_max, n_front = np.inf, np.inf, -np.inf, -np.inf, 0
    for i in range(len(vertices)):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        zc = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if zc < NEAR_M:
            projected[i, 2] = 0.0
            continue
        inv = 1.0 / zc
        u = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) * inv * fx + cx
        v = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) * inv * fy + cy
        projected[i, 0] = u
        projected[i, 1] = v
        projected[i, 2] = inv
        u_min, u_max = min(u_min, u), max(u_max, u)
        v_min, v_max = min(v_min, v), max(v_max, v)
        n_front += 1
    return u_min, v_min, u_max, v_max, n_front


@kernel()
def _bound(a, b, u, v):
    """The edge a·(x − u) + b·(y − v) ≥ 0 as bounds of a row: x ≥ left + left_slope·y and x ≤ right + right_slope·y."""
    if a == 0.0:
        return -UNBOUNDED_PX, 0.0, UNBOUNDED_PX, 0.0
    slope = -b / a
    start = u - slope * v
    slack = EDGE_PX * (1.0 + abs(slope))
    if a > 0.0:
        return start - slack, slope, UNBOUNDED_PX, 0.0
    return -UNBOUNDED_PX, 0.0, start + slack, slope


@kernel()
def fill(inv_z, face_of, x0, y0, face, ua, va, ia, ub, vb, ib, uc, vc, ic):
    """Draws one projected triangle into the window of the image that starts at column x0, row y0."""
    height, width = inv_z.shape
    top, bottom = max(y0, min(va, vb, vc) - EDGE_PX), min(y0 + height - 1, max(va, vb, vc) + EDGE_PX)
    if not top <= bottom:
        return
    leftmost, rightmost = max(x0, min(ua, ub, uc) - EDGE_PX), min(x0 + width - 1, max(ua, ub, uc) + EDGE_PX)
    if not leftmost <= rightmost:
        return
    y_first, y_last = int(np.ceil(top)), int(np.floor(bottom))
    x_first, x_last = int(np.ceil(leftmost)), int(np.floor(rightmost))
    area = (ub - ua) * (vc - va) - (vb - va) * (uc - ua)
    if y_first > y_last or x_first > x_last or area == 0.0:
        return
    # Inside is where all three edge functions a·u + b·v + c are positive; solved for u, each bounds a row from the left
    # (a > 0) or from the right (a < 0). A level edge (a = 0) bounds rows only, which is done already.
    turn = 1.0 if area > 0.0 else -1.0
    left_0, left_slope_0, right_0, right_slope_0 = _bound(turn * (va - vb), turn * (ub - ua), ua, va)
    left_1, left_slope_1, right_1, right_slope_1 = _bound(turn * (vb - vc), turn * (uc - ub), ub, vb)
    left_2, left_slope_2, right_2, right_slope_2 = _bound(turn * (vc - va), turn * (ua - uc), uc, vc)
    slope_u = ((ib - ia) * (vc - va) - (ic - ia) * (vb - va)) / area
    slope_v = ((ub - ua) * (ic - ia) - (uc - ua) * (ib - ia)) / area
    # Slivers have steep slopes that rounding would amplify; the surface never leaves the range of its corners.
    nearest, farthest = max(ia, ib, ic), min(ia, ib, ic)
    for y in range(y_first, y_last + 1):
        left = max(left_0 + left_slope_0 * y, left_1 + left_slope_1 * y, left_2 + left_slope_2 * y, x_first)
        right = min(right_0 + right_slope_0 * y, right_1 + right_slope_1 * y, right_2 + right_slope_2 * y, x_last)
        row = ia + slope_v * (y - va) - slope_u * ua
        first = np.ceil(left)
        if first <= right:  # Both are numbers then, and lie between x_first and x_last.
            for x in range(int(first), int(right) + 1):
                inv = np.float32(min(max(row + slope_u * x, farthest), nearest))
                if inv > inv_z[y - y0, x - x0]:
                    inv_z[y - y0, x - x0] = inv
                    face_of[y - y0, x - x0] = face


@kernel()
def fill_clipped(inv_z, face_of, x0, y0, face, T, corners, fx, fy, cx, cy):
    """Draws a triangle (3, 3) that crosses the near plane: the part in front of it, one or two triangles."""
    part = np.empty((4, 3))
    n = 0
    R, t = np.ascontiguousarray(T[:3, :3]), T[:3, 3]
    previous = R @ corners[2] + t
    for k in range(3):
        current = R @ corners[k] + t
        if (previous[2] >= NEAR_M) != (current[2] >= NEAR_M):
            s = (NEAR_M - previous[2]) / (current[2] - previous[2])
            part[n] = previous + s * (current - previous)
            part[n, 2] = NEAR_M
            n += 1
        if current[2] >= NEAR_M:
            part[n] = current
            n += 1
        previous = current
    for i in range(n):
        part[i, 0] = part[i, 0] / part[i, 2] * fx + cx
        part[i, 1] = part[i, 1] / part[i, 2] * fy + cy
        part[i, 2] = 1.0 / part[i, 2]
    for i in range(1, n - 1):
        a, b, c = part[0], part[i], part[i + 1]
        fill(inv_z, face_of, x0, y0, face, a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2])


@kernel()
def window(T, vertices, fx, fy, cx, cy, height, width, projected):
    """Projects the vertices and gives the window of the image that holds the model.

    Returns:
        (x0, y0, columns, rows, number of vertices in front of the near plane); 0 columns where nothing shows.
    """
    if not is_drawable(T):
        return 0, 0, 0, 0, 0
    u_min, v_min, u_max, v_max, n_front = project(T, vertices, fx, fy, cx, cy, projected)
    if n_front == 0:
        return 0, 0, 0, 0, 0
    if n_front < len(vertices):
        # What is cut off at the near plane may reach any border of the image.
        return 0, 0, width, height, n_front
    x0, x1 = clamped(np.ceil(u_min - EDGE_PX), 0, width), clamped(np.floor(u_max + EDGE_PX), -1, width - 1)
    y0, y1 = clamped(np.ceil(v_min - EDGE_PX), 0, height), clamped(np.floor(v_max + EDGE_PX), -1, height - 1)
    if x0 > x1 or y0 > y1:
        return 0, 0, 0, 0, n_front
    return x0, y0, x1 - x0 + 1, y1 - y0 + 1, n_front


@kernel()
def eye_in_object(T):
    """The camera's centre in the object frame [m]: which side of a face is seen is a matter of the face's plane."""
    x = -(T[0, 0] * T[0, 3] + T[1, 0] * T[1, 3] + T[2, 0] * T[2, 3])
    y = -(T[0, 1] * T[0, 3] + T[1, 1] * T[1, 3] + T[2, 1] * T[2, 3])
    z = -(T[0, 2] * T[0, 3] + T[1, 2] * T[1, 3] + T[2, 2] * T[2, 3])
    return x, y, z


@kernel()
def draw(
    T, vertices, faces, normals, offsets, closed, projected, n_front, fx, fy, cx, cy, inv_z, face_of, x0, y0, first_face
):
    """Draws a model into a window, after :func:`window` filled ``projected``.

    Faces turned to the camera come first. Others that are part of a closed surface are left out, unless the near plane
    opens it. Most that remain lie behind what is drawn; a coarse grid of the farthest surface so far tells which,
    without reading their pixels. The picture is that of all faces.

    Args:
        T: (4, 4) T_cam_obj.
        vertices: (V, 3) [m].
        faces: (F, 3) vertex indices.
        normals: (F, 3) unit face normals, object frame.
        offsets: (F,) n·p of each face's plane [m].
        closed: (F,) whether the face is part of a closed surface.
        projected: (V, 3) u, v, 1/z.
        n_front: how many vertices are in front of the near plane.
        fx: as fy, cx, cy: the camera [px].
        fy: [px].
        cx: [px].
        cy: [px].
        inv_z: (rows, columns) float32, 1/z [1/m], 0 = empty.
        face_of: (rows, columns) int32, the face that is seen.
        x0: first column of the window in the image.
        y0: first row.
        first_face: what to add to a face's number: several models may share one window.
    """
    all_in_front = n_front == len(vertices)
    eye_x, eye_y, eye_z = eye_in_object(T)
    n_later = 0
    later = np.empty(len(faces), np.int32)
    for f in range(len(faces)):
        if normals[f, 0] * eye_x + normals[f, 1] * eye_y + normals[f, 2] * eye_z < offsets[f]:
            if not (closed[f] and all_in_front):
                later[n_later] = f
                n_later += 1
            continue
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if all_in_front or (projected[a, 2] > 0 and projected[b, 2] > 0 and projected[c, 2] > 0):
            fill(
                inv_z, face_of, x0, y0, first_face + f,
                projected[a, 0], projected[a, 1], projected[a, 2],
                projected[b, 0], projected[b, 1], projected[b, 2],
                projected[c, 0], projected[c, 1], projected[c, 2],
            )  # fmt: skip
        elif projected[a, 2] > 0 or projected[b, 2] > 0 or projected[c, 2] > 0:
            later[n_later] = f
            n_later += 1

    if n_later == 0:
        return
    farthest = _coarse(inv_z)
    for i in range(n_later):
        f = later[i]
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if all_in_front or (projected[a, 2] > 0 and projected[b, 2] > 0 and projected[c, 2] > 0):
            ua, va, ia = projected[a, 0], projected[a, 1], projected[a, 2]
            ub, vb, ib = projected[b, 0], projected[b, 1], projected[b, 2]
            uc, vc, ic = projected[c, 0], projected[c, 1], projected[c, 2]
            u_min, u_max, v_min, v_max = min(ua, ub, uc), max(ua, ub, uc), min(va, vb, vc), max(va, vb, vc)
            if not _is_hidden(farthest, u_min - x0, u_max - x0, v_min - y0, v_max - y0, max(ia, ib, ic)):
                fill(inv_z, face_of, x0, y0, first_face + f, ua, va, ia, ub, vb, ib, uc, vc, ic)
        elif projected[a, 2] > 0 or projected[b, 2] > 0 or projected[c, 2] > 0:
            corners = np.empty((3, 3))
            corners[0], corners[1], corners[2] = vertices[a], vertices[b], vertices[c]
            fill_clipped(inv_z, face_of, x0, y0, first_face + f, T, corners, fx, fy, cx, cy)


@kernel()
def _coarse(inv_z):
    """The smallest 1/z of each block of ``BLOCK_PX`` × ``BLOCK_PX`` pixels."""
    rows, columns = inv_z.shape
    out = np.full(((rows + BLOCK_PX - 1) >> BLOCK_BITS, (columns + BLOCK_PX - 1) >> BLOCK_BITS), np.inf, np.float32)
    for y in range(rows):
        for block in range(out.shape[1]):
            least = out[y >> BLOCK_BITS, block]
            for x in range(block << BLOCK_BITS, min((block + 1) << BLOCK_BITS, columns)):
                least = min(least, inv_z[y, x])
            out[y >> BLOCK_BITS, block] = least
    return out


@kernel()
def _is_hidden(farthest, u_min, u_max, v_min, v_max, nearest):
    """Whether all blocks under a box of window pixels show a surface nearer than 1/z = ``nearest``."""
    rows, columns = farthest.shape
    x_first = clamped(u_min - 1.0, 0, columns << BLOCK_BITS) >> BLOCK_BITS
    x_last = clamped(u_max + 1.0, 0, (columns << BLOCK_BITS) - 1) >> BLOCK_BITS
    y_first = clamped(v_min - 1.0, 0, rows << BLOCK_BITS) >> BLOCK_BITS
    y_last = clamped(v_max + 1.0, 0, (rows << BLOCK_BITS) - 1) >> BLOCK_BITS
    for y in range(y_first, y_last + 1):
        for x in range(x_first, x_last + 1):
            if farthest[y, x] < nearest:
                return False
    return True


@kernel()
def draw_frame(T, vertices, faces, normals, offsets, closed, fx, fy, cx, cy, inv_z, face_of):
    """Draws a model into a whole image; pixels it wins get its face, so several models may share ``inv_z``."""
    height, width = inv_z.shape
    projected = np.empty((len(vertices), 3))
    _, _, columns, _, n_front = window(T, vertices, fx, fy, cx, cy, height, width, projected)
    if columns > 0:
        draw(
            T, vertices, faces, normals, offsets, closed, projected, n_front,
            fx, fy, cx, cy, inv_z, face_of, np.int64(0), np.int64(0), np.int64(0),
        )  # fmt: skip


@kernel(nogil=True)
def draw_depth(T, vertices, faces, normals, offsets, closed, fx, fy, cx, cy, depth):
    """Draws a model into an image of z [m], 0 = empty, where it is nearer than what is there."""
    height, width = depth.shape
    projected = np.empty((len(vertices), 3))
    x0, y0, columns, rows, n_front = window(T, vertices, fx, fy, cx, cy, height, width, projected)
    if columns == 0:
        return
    inv_z, face_of = np.zeros((rows, columns), np.float32), np.empty((rows, columns), np.int32)
    draw(
        T, vertices, faces, normals, offsets, closed, projected, n_front,
        fx, fy, cx, cy, inv_z, face_of, x0, y0, np.int64(0),
    )  # fmt: skip
    for y in range(rows):
        for x in range(columns):
            if inv_z[y, x] > 0.0:
                z, before = np.float32(1.0 / np.float64(inv_z[y, x])), depth[y + y0, x + x0]
                if before == 0.0 or z < before:
                    depth[y + y0, x + x0] = z
