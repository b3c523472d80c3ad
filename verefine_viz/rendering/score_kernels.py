"""Scores of poses (Eq. 1) on the CPU: each pose is drawn into its own small window and summed in the same pass; and the
same pixel by pixel (:func:`fill_maps`), for the screen and for recordings.

What is scored is a combination of poses, one of each of m models that share one depth buffer; a lone object is m = 1.
Only pixels on which a model shows are visited: what the rest of the image adds (missed pixels of the mask, other
objects' pixels in N) is known beforehand, so the sums are those of the whole image. A pose's sum runs in one order in
one thread, hence the same bits with any number of threads.
"""

from __future__ import annotations

import math

import numpy as np
from numba import config

from verefine_viz.core.kernels import kernel
from verefine_viz.rendering.rasterizer import clamped, draw, eye_in_object, window

# numba tries TBB first and warns where open3d has brought along an older one.
config.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]  # pyright: ignore[reportAttributeAccessIssue]

OWN, OBJECTS = 1, 2
"""Bits of a pixel's flags; both stand for a valid depth: in a mask of the instances that are scored, in any mask whose
pixels count when they are ``PUBLISHED``."""

PUBLISHED, OBSERVED, CLASSES = 0, 1, 2
"""How pixels are counted (``ScoreSettings.pixels``)."""

EXPLAINED, MISSED, PROTRUDING, HIDDEN, UNKNOWN = 0, 1, 2, 3, 4

N_SUMS = 9
"""Columns of a pose's sums: Σ f_d, Σ f_n, N, rendered pixels, then the five classes."""


@kernel()
def classify(observed, rendered, other, is_own, any_own, tau):
    """The class of a pixel on which a model shows (docs/methods.md 1.9).

    Args:
        observed: measured z [m]; 0 where nothing was measured.
        rendered: z of the model > 0 [m].
        other: z of the objects placed before, 0 = none [m].
        is_own: the pixel is in the mask of the instance whose model shows.
        any_own: the pixel is in the mask of any instance that is scored.
        tau: depth tolerance [m].
    """
    if observed == 0.0:
        return UNKNOWN
    near = abs(observed - rendered) < tau
    if near and is_own:
        return EXPLAINED
    if not near and observed > rendered:
        return PROTRUDING
    if 0.0 < other < rendered and abs(observed - other) < tau:
        return HIDDEN
    if near:
        return PROTRUDING
    if any_own:
        return MISSED
    return HIDDEN


@kernel()
def fits_into(kind, any_own, is_object, pixels):
    """Whether a pixel on which a model shows counts in the sums of Eq. 1 (docs/methods.md 1.8.1)."""
    if pixels == PUBLISHED:
        return is_object
    return any_own if pixels == OBSERVED else kind == EXPLAINED


@kernel()
def fit_of(d, z, dot, has_normal, pixels, per_tau, per_alpha):
    """f_d and f_n of Eq. 1 at a pixel.

    Args:
        d: measured z > 0 [m].
        z: rendered z > 0 [m].
        dot: n · n̂ of the normals; whatever it is where no normal was observed.
        has_normal: whether a normal was observed; where not, f_d counts in its place (docs/methods.md 1.8.26).
        pixels: ``PUBLISHED``, ``OBSERVED`` or ``CLASSES``.
        per_tau: 1 / τ [1/m].
        per_alpha: 1 / α.
    """
    # f_d = max(0, 1 − |d − d̂| / τ), f_n = max(0, 1 − (1 − n·n̂) / α).
    f_d = max(0.0, 1.0 - abs(d - z) * per_tau)
    if pixels != PUBLISHED and not has_normal:
        return f_d, f_d
    return f_d, max(0.0, 1.0 - (1.0 - min(max(dot, 0.0), 1.0)) * per_alpha)


@kernel()
def score_scene(Ts, meshes, camera, far, seen, rule, colours, sums, colour_sums):
    """Fills ``sums`` (``N_SUMS``,) for one combination of poses.

    Args:
        Ts: (m, 4, 4) T_cam_obj of each model.
        meshes: ``RenderMeshes.arrays``.
        camera: (fx, fy, cx, cy) [px].
        far: farthest surface that is drawn [m].
        seen: ``PreparedTarget.arrays``: what was observed.
        rule: (pixels, τ, α): ``PUBLISHED``, ``OBSERVED`` or ``CLASSES``, depth tolerance [m], tolerance of 1 − n·n̂.
        colours: ``SceneColours.arrays``, or ``NO_COLOURS``.
        sums: (9,) result.
        colour_sums: (m, ``N_COLOUR_SUMS``) result, so far 0; with ``NO_COLOURS`` it is not touched.
    """
    x0, y0, inv_z, face_of = draw_window(Ts, meshes, camera, seen[1].shape[0], seen[1].shape[1])
    _sum(inv_z, face_of, x0, y0, _facing(Ts, meshes), meshes[6], far, seen, rule, sums)
    if len(colours[0]) > 0:
        _sum_colours(inv_z, face_of, x0, y0, Ts, meshes[6], camera, far, seen, rule[1], colours, colour_sums)


@kernel()
def _facing(Ts, meshes):
    """(F, 3) normals of all faces, on the side that is seen, in the camera frame."""
    normals, offsets, face_starts = meshes[2], meshes[3], meshes[6]
    out = np.empty(normals.shape)
    for k in range(len(Ts)):
        T = Ts[k]
        eye_x, eye_y, eye_z = eye_in_object(T)
        for f in range(face_starts[k], face_starts[k + 1]):
            a, b, c = normals[f, 0], normals[f, 1], normals[f, 2]
            side = -1.0 if a * eye_x + b * eye_y + c * eye_z < offsets[f] else 1.0
            for i in range(3):
                out[f, i] = side * (T[i, 0] * a + T[i, 1] * b + T[i, 2] * c)
    return out


@kernel()
def _sum(inv_z, face_of, x0, y0, facing, face_starts, far, seen, rule, sums):
    """Eq. 1. Fills ``sums`` from the window that starts at column x0, row y0: 1/z and the faces that are seen."""
    observed, flags, own, placed, n_objects, n_own = seen
    pixels, tau, alpha = rule
    rows, columns = inv_z.shape
    per_tau, per_alpha = 1.0 / tau, 1.0 / alpha
    sum_d, sum_n, n_rendered, n_stray = 0.0, 0.0, 0, 0
    counts = np.zeros(5, np.int64)
    n_covered = 0
    for y in range(rows):
        for x in range(columns):
            if inv_z[y, x] == 0.0:
                continue
            z = 1.0 / np.float64(inv_z[y, x])
            if z > far:
                continue
            n_rendered += 1
            v, u = y + y0, x + x0
            flag = flags[v, u]
            f, k = face_of[y, x], 0
            while f >= face_starts[k + 1]:
                k += 1
            d = np.float64(observed[v, u, 3])
            any_own = (flag & OWN) != 0
            other = np.float64(placed[v, u]) if placed.shape[0] > 0 else 0.0
            kind = classify(d, z, other, (own[k, v, u] & OWN) != 0, any_own, tau)
            counts[kind] += 1
            if any_own:
                n_covered += 1
            if (flag & OBJECTS) == 0:
                n_stray += 1
            if fits_into(kind, any_own, (flag & OBJECTS) != 0, pixels):
                nx = np.float64(observed[v, u, 0])
                ny = np.float64(observed[v, u, 1])
                nz = np.float64(observed[v, u, 2])
                dot = nx * facing[f, 0] + ny * facing[f, 1] + nz * facing[f, 2]
                has_normal = nx != 0.0 or ny != 0.0 or nz != 0.0
                f_d, f_n = fit_of(d, z, dot, has_normal, pixels, per_tau, per_alpha)
                sum_d += f_d
                sum_n += f_n
    counts[MISSED] += n_own - n_covered
    sums[0], sums[1], sums[3] = sum_d, sum_n, n_rendered
    # N of Eq. 1: docs/methods.md 1.8.1 and 1.8.3.
    if pixels == PUBLISHED:
        sums[2] = n_objects + n_stray
    elif pixels == OBSERVED:
        sums[2] = n_own
    else:
        sums[2] = counts[EXPLAINED] + counts[MISSED] + counts[PROTRUDING]
    for k in range(5):
        sums[4 + k] = counts[k]


@kernel()
def _sum_colours(inv_z, face_of, x0, y0, Ts, face_starts, camera, far, seen, tau, colours, sums):
    """What f_c is made of (``colour.correlations``): fills ``sums`` (m, ``N_COLOUR_SUMS``) over explained pixels.

    Those with u + v even, as on a chessboard: the smoothed image says nothing new in between.
    """
    observed, own = seen[0], seen[2]
    cells, starts, shapes, origins, per_metre, image = colours
    rays = _cell_rays(Ts, camera, origins, per_metre)
    for k in range(len(Ts)):  # Model by model, so that its sums stay in registers.
        if starts[k] == starts[k + 1]:
            continue
        first, last = face_starts[k], face_starts[k + 1]
        n, sa0, sa1, sa2, sb0, sb1, sb2, saa, sbb, sab = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for y in range(inv_z.shape[0]):
            v = y + y0
            for x in range((v + x0) % 2, inv_z.shape[1], 2):
                u = x + x0
                if inv_z[y, x] == 0.0 or (own[k, v, u] & OWN) == 0 or not first <= face_of[y, x] < last:
                    continue
                z, d = 1.0 / np.float64(inv_z[y, x]), np.float64(observed[v, u, 3])
                if z > far or d == 0.0 or abs(d - z) >= tau:
                    continue
                at = starts[k] + _cell(rays[k], shapes[k], u, v, z)
                a0, a1, a2 = np.float64(cells[at, 0]), np.float64(cells[at, 1]), np.float64(cells[at, 2])
                b0, b1, b2 = np.float64(image[v, u, 0]), np.float64(image[v, u, 1]), np.float64(image[v, u, 2])
                n += 1.0
                sa0, sa1, sa2 = sa0 + a0, sa1 + a1, sa2 + a2
                sb0, sb1, sb2 = sb0 + b0, sb1 + b1, sb2 + b2
                saa += a0 * a0 + a1 * a1 + a2 * a2
                sbb += b0 * b0 + b1 * b1 + b2 * b2
                sab += a0 * b0 + a1 * b1 + a2 * b2
        sums[k, 0], sums[k, 1], sums[k, 2], sums[k, 3], sums[k, 4] = n, sa0, sa1, sa2, sb0
        sums[k, 5], sums[k, 6], sums[k, 7], sums[k, 8], sums[k, 9] = sb1, sb2, saa, sbb, sab


@kernel()
def _cell_rays(Ts, camera, origins, per_metre):
    """(m, 3, 4) A, B, C, D of each model: pixel (u, v) at depth z shows the point z (A u + B v + C) + D, in cells."""
    fx, fy, cx, cy = camera
    out = np.empty((len(Ts), 3, 4))
    for k in range(len(Ts)):
        T = Ts[k]
        for i in range(3):
            a, b = T[0, i] / fx, T[1, i] / fy
            back = T[0, i] * T[0, 3] + T[1, i] * T[1, 3] + T[2, i] * T[2, 3]
            out[k, i, 0], out[k, i, 1] = a * per_metre[k], b * per_metre[k]
            out[k, i, 2] = (T[2, i] - a * cx - b * cy) * per_metre[k]
            out[k, i, 3] = -(back + origins[k, i]) * per_metre[k]
    return out


@kernel()
def _cell(rays, shape, u, v, z):
    """Which of a model's cells, counted through, the point of a pixel lies in, or the nearest one."""
    at = 0
    for i in range(3):
        along = z * (rays[i, 0] * u + rays[i, 1] * v + rays[i, 2]) + rays[i, 3]
        at = at * shape[i] + clamped(along, 0, shape[i] - 1)
    return at


@kernel()
def draw_window(Ts, meshes, camera, height, width):
    """Draws the models into the window of the image that holds them all.

    Returns:
        Its first column and row, 1/z (rows, columns) [1/m] and the face that is seen, counted through all models. It
        lies within the image whatever camera and poses are given.
    """
    vertices, faces, normals, offsets, closed, vertex_starts, face_starts = meshes
    fx, fy, cx, cy = camera
    projected = np.empty((len(vertices), 3))
    n_front, shows = np.empty(len(Ts), np.int64), np.zeros(len(Ts), np.bool_)
    left, top, right, bottom = width, height, 0, 0
    for k in range(len(Ts)):
        a, b = vertex_starts[k], vertex_starts[k + 1]
        x0, y0, columns, rows, n_front[k] = window(Ts[k], vertices[a:b], fx, fy, cx, cy, height, width, projected[a:b])
        if columns > 0:
            shows[k] = True
            left, top, right, bottom = min(left, x0), min(top, y0), max(right, x0 + columns), max(bottom, y0 + rows)
    inv_z = np.zeros((max(bottom - top, 0), max(right - left, 0)), np.float32)
    face_of = np.empty(inv_z.shape, np.int32)
    for k in range(len(Ts)):
        if shows[k]:
            a, b, c, d = vertex_starts[k], vertex_starts[k + 1], face_starts[k], face_starts[k + 1]
            draw(
                Ts[k], vertices[a:b], faces[c:d], normals[c:d], offsets[c:d], closed[c:d], projected[a:b], n_front[k],
                fx, fy, cx, cy, inv_z, face_of, left, top, c,
            )  # fmt: skip
    return left, top, inv_z, face_of


@kernel(nogil=True)
def score_every(first, step, Ts, meshes, camera, far, seen, rule, colours, out, colours_out):
    """:func:`score_scene` of combinations first, first + step, …; several threads may each take their share."""
    for i in range(first, len(Ts), step):
        score_scene(Ts[i], meshes, camera, far, seen, rule, colours, out[i], colours_out[i])


@kernel()
def windows(Ts, meshes, camera, height, width):
    """The windows of the image, (N, m, 4) x0, y0, columns, rows [px], that hold each model of N combinations of poses
    (N, m, 4, 4); 0 columns for none.
    """
    vertices, _, _, _, _, starts, _ = meshes
    fx, fy, cx, cy = camera
    out = np.zeros((Ts.shape[0], Ts.shape[1], 4), np.int64)
    projected = np.empty((len(vertices), 3))
    for i in range(Ts.shape[0]):
        for k in range(Ts.shape[1]):
            some = vertices[starts[k] : starts[k + 1]]
            x0, y0, columns, rows, _ = window(Ts[i, k], some, fx, fy, cx, cy, height, width, projected)
            out[i, k, 0], out[i, k, 1], out[i, k, 2], out[i, k, 3] = x0, y0, columns, rows
    return out


@kernel(nogil=True)
def draw_at(Ts, meshes, camera, shape, far, rows, columns, depth, faces):
    """Fills ``depth`` and ``faces`` (h, w), all 0 so far, with z [m] and face of the models at the pixels of a grid,
    whatever camera and poses are given.

    Args:
        Ts: (m, 4, 4) T_cam_obj of each model.
        meshes: ``RenderMeshes.arrays``.
        camera: (fx, fy, cx, cy) [px].
        shape: (H, W) of the image.
        far: what is beyond is not drawn [m].
        rows: (h,) of the pixels of the grid.
        columns: (w,) of them.
        depth: (h, w) float32 result, 0 = empty.
        faces: (h, w) int32 result, counted through all models.
    """
    left, top, inv_z, face_of = draw_window(Ts, meshes, camera, *shape)
    for y in range(len(rows)):
        v = rows[y] - top
        if 0 <= v < inv_z.shape[0]:
            for x in range(len(columns)):
                u = columns[x] - left
                if 0 <= u < inv_z.shape[1] and inv_z[v, u] > 0.0:
                    z = np.float32(1.0) / inv_z[v, u]
                    if z <= far:
                        depth[y, x], faces[y, x] = z, face_of[v, u]


@kernel(nogil=True)
def fill_maps(Ts, meshes, rows, columns, depth, faces, camera, seen, rule, maps):
    """Eq. 1 pixel by pixel: fills the fields of ``ScoreMaps``.

    Args:
        Ts: as in :func:`score_scene`, and so are meshes, camera, seen and rule.
        meshes: as there.
        rows: (h,) of the pixels of the grid.
        columns: (w,) of them.
        depth: (h, w) z of the models there [m]; 0 = empty.
        faces: (h, w) the face that is seen there, counted through all models.
        camera: as there.
        seen: as there.
        rule: as there.
        maps: results: normals (h, w, 3), difference, angle, f_d, f_n, counted and classes (h, w); so far NaN in
            difference and angle, 0 in the others.
    """
    face_normals, face_starts = meshes[2], meshes[6]
    observed, flags, own, placed, _, _ = seen
    pixels, tau, alpha = rule
    normals, difference, angle, f_d, f_n, counted, classes = maps
    fx, fy, cx, cy = camera
    for y in range(len(rows)):
        v = rows[y]
        for x in range(len(columns)):
            u = columns[x]
            z, flag = np.float64(depth[y, x]), flags[v, u]
            drawn, any_own, objects = z > 0.0, (flag & OWN) != 0, (flag & OBJECTS) != 0
            counted[y, x] = (drawn or objects) if pixels == PUBLISHED else any_own
            if not drawn:
                if any_own:
                    classes[y, x] = MISSED + 1
                continue
            f, k = faces[y, x], 0
            while f >= face_starts[k + 1]:
                k += 1
            T, n = Ts[k], face_normals[f]
            a = T[0, 0] * n[0] + T[0, 1] * n[1] + T[0, 2] * n[2]
            b = T[1, 0] * n[0] + T[1, 1] * n[1] + T[1, 2] * n[2]
            c = T[2, 0] * n[0] + T[2, 1] * n[1] + T[2, 2] * n[2]
            side = -1.0 if a * (u - cx) / fx + b * (v - cy) / fy + c > 0.0 else 1.0
            normals[y, x, 0], normals[y, x, 1], normals[y, x, 2] = side * a, side * b, side * c
            d = np.float64(observed[v, u, 3])
            other = np.float64(placed[v, u]) if placed.shape[0] > 0 else 0.0
            kind = classify(d, z, other, (own[k, v, u] & OWN) != 0, any_own, tau)
            classes[y, x] = kind + 1
            if pixels == CLASSES:
                counted[y, x] = kind in (EXPLAINED, MISSED, PROTRUDING)
            if d > 0.0:
                difference[y, x] = d - z
            dot, has_normal = 0.0, False
            for i in range(3):
                n_obs = np.float64(observed[v, u, i])
                dot += n_obs * np.float64(normals[y, x, i])
                has_normal = has_normal or n_obs != 0.0
            if has_normal:
                angle[y, x] = math.acos(min(max(dot, 0.0), 1.0))
            if fits_into(kind, any_own, objects, pixels):
                f_d[y, x], f_n[y, x] = fit_of(d, z, dot, has_normal, pixels, 1.0 / tau, 1.0 / alpha)
