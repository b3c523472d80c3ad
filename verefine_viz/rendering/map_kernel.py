"""Eq. 1 pixel by pixel, in one compiled pass over the pixels that somebody looks at."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from verefine_viz.rendering.kernels import (
    EXPLAINED,
    MISSED,
    OBJECTS,
    OBSERVED,
    OWN,
    PROTRUDING,
    PUBLISHED,
    classify,
    draw_window,
)


@njit(cache=True, nogil=True)
def draw_at(Ts, meshes, camera, shape, far, rows, columns, depth, faces):
    """Fills ``depth`` and ``faces`` (h, w), all 0 so far, with z [m] and face of the models at the pixels of a grid,
    whatever camera and poses are given.

    Args:
        Ts: (m, 4, 4) T_cam_obj of each model.
        meshes: ``RenderMeshes.arrays``.
        camera: (fx, fy, cx, cy) [px].
        shape: (H, W) of the image.
        far: what is beyond is left out [m].
        rows: (h,) of the pixels that are looked at.
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


@njit(cache=True, nogil=True)
def fill_maps(
    Ts,
    face_normals,
    face_starts,
    rows,
    columns,
    depth,
    faces,
    camera,
    observed,
    flags,
    own,
    placed,
    pixels,
    tau,
    alpha,
    normals,
    difference,
    angle,
    f_d,
    f_n,
    counted,
    classes,
):
    """Fills the fields of ``ScoreMaps``.

    Args:
        Ts: (m, 4, 4) T_cam_obj of each model.
        face_normals: (ΣF, 3) of ``RenderMeshes``.
        face_starts: (m + 1,) of ``RenderMeshes``.
        rows: (h,) of the pixels that are looked at.
        columns: (w,) of them.
        depth: (h, w) z of the models there [m]; 0 = empty.
        faces: (h, w) the face that is seen there, counted through all models.
        camera: (fx, fy, cx, cy) [px].
        observed: (H, W, 4) normal and depth; 0 where missing.
        flags: (H, W) bits ``OWN``, ``OBJECTS``.
        own: (m, H, W) the bit ``OWN`` of each instance by itself.
        placed: (H, W) z of the objects placed before, or (0, 0) for none [m].
        pixels: ``PUBLISHED``, ``OBSERVED`` or ``CLASSES``.
        tau: depth tolerance [m].
        alpha: tolerance of 1 − n·n̂.
        normals: (h, w, 3) result, all 0 so far, as are the others unless said.
        difference: (h, w) result, NaN so far.
        angle: (h, w) result, NaN so far.
        f_d: (h, w) result.
        f_n: (h, w) result.
        counted: (h, w) result.
        classes: (h, w) result.
    """
    fx, fy, cx, cy = camera
    for y in range(len(rows)):
        v = rows[y]
        for x in range(len(columns)):
            u = columns[x]
            z, flag = np.float64(depth[y, x]), flags[v, u]
            drawn, is_own, is_any = z > 0.0, (flag & OWN) != 0, (flag & OBJECTS) != 0
            counted[y, x] = (drawn or is_any) if pixels == PUBLISHED else is_own
            if not drawn:
                if is_own:
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
            kind = classify(d, z, other, (own[k, v, u] & OWN) != 0, is_own, tau)
            classes[y, x] = kind + 1
            if pixels == PUBLISHED:
                fits = is_any
            elif pixels == OBSERVED:
                fits = is_own
            else:
                fits = kind == EXPLAINED
                counted[y, x] = fits or kind in (MISSED, PROTRUDING)
            if d > 0.0:
                difference[y, x] = d - z
            # Eq. 1: f_d, and below f_n.
            depth_fit = max(0.0, 1.0 - abs(d - z) / tau) if fits else 0.0
            f_d[y, x] = depth_fit
            dot, has_normal = 0.0, False
            for i in range(3):
                seen = np.float64(observed[v, u, i])
                dot += seen * np.float64(normals[y, x, i])
                has_normal = has_normal or seen != 0.0
            dot = min(max(dot, 0.0), 1.0)
            if has_normal:
                angle[y, x] = math.acos(dot)
            if fits:
                without = pixels != PUBLISHED and not has_normal
                f_n[y, x] = depth_fit if without else max(0.0, 1.0 - (1.0 - dot) / alpha)
