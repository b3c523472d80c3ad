"""Scores of poses on the CPU: each pose is drawn into its own small window and summed in the same pass.

Only pixels on which the model shows are visited: what the rest of the image adds (missed pixels of the mask, other
objects' pixels in N) is known beforehand, so the sums are those of the whole image. A pose's sum runs in one order in
one thread, hence the same bits with any number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import config, njit

from verefine_viz.rendering.rasterizer import draw, eye_in_object, window

# numba tries TBB first and warns where open3d has brought along an older one.
config.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]  # pyright: ignore[reportAttributeAccessIssue]

OWN, OBJECTS = 1, 2
"""Bits of a pixel's flags; both stand for a valid depth: in the instance's own mask, in any instance's."""

PUBLISHED, OBSERVED, CLASSES = 0, 1, 2
"""How pixels are counted (``ScoreSettings.pixels``)."""

EXPLAINED, MISSED, PROTRUDING, HIDDEN, UNKNOWN = 0, 1, 2, 3, 4

N_SUMS = 9
"""Columns of a pose's sums: Σ f_d, Σ f_n, N, rendered pixels, then the five classes."""


@njit(cache=True)
def classify(observed, rendered, other, is_own, tau):
    """The class of a pixel on which the model shows.

    Args:
        observed: measured z [m]; 0 where nothing was measured.
        rendered: z of the model > 0 [m].
        other: z of the objects placed before, 0 = none [m].
        is_own: the pixel is in the instance's mask.
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
    if is_own:
        return MISSED
    if near:
        return PROTRUDING
    return HIDDEN


@njit(cache=True)
def score_pose(T, mesh, camera, far, observed, flags, placed, n_objects, n_own, pixels, tau, alpha, sums):
    """Fills ``sums`` (``N_SUMS``,) for one pose.

    Args:
        T: (4, 4) T_cam_obj.
        mesh: vertices, faces, face normals, face offsets; see :func:`rasterizer.draw`.
        camera: (fx, fy, cx, cy) [px].
        far: farthest surface that is drawn [m].
        observed: (H, W, 4) normal and depth; 0 where missing.
        flags: (H, W) bits ``OWN``, ``OBJECTS``.
        placed: (H, W) z of the objects placed before, or (0, 0) for none [m].
        n_objects: how many pixels have the flag ``OBJECTS``.
        n_own: how many have ``OWN``.
        pixels: ``PUBLISHED``, ``OBSERVED`` or ``CLASSES``.
        tau: depth tolerance [m].
        alpha: tolerance of 1 − n·n̂.
        sums: (9,) result.
    """
    vertices, faces, normals, offsets = mesh
    fx, fy, cx, cy = camera
    height, width = flags.shape
    projected = np.empty((len(vertices), 3))
    x0, y0, columns, rows, n_front = window(T, vertices, fx, fy, cx, cy, height, width, projected)
    inv_z = np.zeros((rows, columns), np.float32)
    face_of = np.empty((rows, columns), np.int32)
    if columns > 0:
        draw(T, vertices, faces, normals, offsets, projected, n_front, fx, fy, cx, cy, inv_z, face_of, x0, y0)

    eye = eye_in_object(T)
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
            d = np.float64(observed[v, u, 3])
            is_own = (flag & OWN) != 0
            other = np.float64(placed[v, u]) if placed.shape[0] > 0 else 0.0
            kind = classify(d, z, other, is_own, tau)
            counts[kind] += 1
            if is_own:
                n_covered += 1
            if (flag & OBJECTS) == 0:
                n_stray += 1
            if pixels == PUBLISHED:
                fits = (flag & OBJECTS) != 0
            elif pixels == OBSERVED:
                fits = is_own
            else:
                fits = kind == EXPLAINED
            if fits:
                f_d = max(0.0, 1.0 - abs(d - z) * per_tau)
                sum_d += f_d
                nx = np.float64(observed[v, u, 0])
                ny = np.float64(observed[v, u, 1])
                nz = np.float64(observed[v, u, 2])
                if pixels != PUBLISHED and nx == 0.0 and ny == 0.0 and nz == 0.0:
                    sum_n += f_d
                    continue
                f = face_of[y, x]
                a, b, c = normals[f, 0], normals[f, 1], normals[f, 2]
                dot = (
                    nx * (T[0, 0] * a + T[0, 1] * b + T[0, 2] * c)
                    + ny * (T[1, 0] * a + T[1, 1] * b + T[1, 2] * c)
                    + nz * (T[2, 0] * a + T[2, 1] * b + T[2, 2] * c)
                )
                if a * eye[0] + b * eye[1] + c * eye[2] < offsets[f]:
                    dot = -dot
                sum_n += max(0.0, 1.0 - (1.0 - min(max(dot, 0.0), 1.0)) * per_alpha)
    counts[MISSED] += n_own - n_covered
    sums[0], sums[1], sums[3] = sum_d, sum_n, n_rendered
    if pixels == PUBLISHED:
        sums[2] = n_objects + n_stray
    elif pixels == OBSERVED:
        sums[2] = n_own
    else:
        sums[2] = counts[EXPLAINED] + counts[MISSED] + counts[PROTRUDING]
    for k in range(5):
        sums[4 + k] = counts[k]


@njit(cache=True, nogil=True)
def score_every(first, step, Ts, mesh, camera, far, observed, flags, placed, n_objects, n_own, pixels, tau, alpha, out):
    """:func:`score_pose` of poses first, first + step, …; several threads may each take their share."""
    for i in range(first, len(Ts), step):
        score_pose(Ts[i], mesh, camera, far, observed, flags, placed, n_objects, n_own, pixels, tau, alpha, out[i])


@njit(cache=True)
def windows(Ts, vertices, camera, height, width):
    """The window of the image, (N, 4) x0, y0, columns, rows [px], that holds each of N poses; 0 columns for none."""
    fx, fy, cx, cy = camera
    out = np.zeros((len(Ts), 4), np.int64)
    projected = np.empty((len(vertices), 3))
    for i in range(len(Ts)):
        x0, y0, columns, rows, _ = window(Ts[i], vertices, fx, fy, cx, cy, height, width, projected)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = x0, y0, columns, rows
    return out
