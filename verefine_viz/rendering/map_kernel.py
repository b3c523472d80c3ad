"""Eq. 1 pixel by pixel, in one compiled pass over the image: most of it is neither drawn on nor the object's mask."""

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
)


@njit(cache=True, nogil=True)
def z_of(inv_z, far, depth):
    """Fills ``depth`` (H, W), which is all 0, with z [m] where ``inv_z`` shows something that is not beyond ``far``."""
    height, width = inv_z.shape
    for v in range(height):
        for u in range(width):
            if inv_z[v, u] > 0.0:
                z = np.float32(1.0) / inv_z[v, u]
                if z <= far:
                    depth[v, u] = z


@njit(cache=True, nogil=True)
def fill_maps(
    Ts,
    face_normals,
    face_starts,
    depth,
    face_of,
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
        depth: (H, W) z of the models [m]; 0 = empty.
        face_of: (H, W) the face that is seen, counted through all models.
        camera: (fx, fy, cx, cy) [px].
        observed: (H, W, 4) normal and depth; 0 where missing.
        flags: (H, W) bits ``OWN``, ``OBJECTS``.
        own: (m, H, W) the bit ``OWN`` of each instance by itself.
        placed: (H, W) z of the objects placed before, or (0, 0) for none [m].
        pixels: ``PUBLISHED``, ``OBSERVED`` or ``CLASSES``.
        tau: depth tolerance [m].
        alpha: tolerance of 1 − n·n̂.
        normals: (H, W, 3) result, all 0 so far, as are the others unless said.
        difference: (H, W) result, NaN so far.
        angle: (H, W) result, NaN so far.
        f_d: (H, W) result.
        f_n: (H, W) result.
        counted: (H, W) result.
        classes: (H, W) result.
    """
    fx, fy, cx, cy = camera
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            z, flag = np.float64(depth[v, u]), flags[v, u]
            drawn, is_own, is_any = z > 0.0, (flag & OWN) != 0, (flag & OBJECTS) != 0
            counted[v, u] = (drawn or is_any) if pixels == PUBLISHED else is_own
            if not drawn:
                if is_own:
                    classes[v, u] = MISSED + 1
                continue
            f, k = face_of[v, u], 0
            while f >= face_starts[k + 1]:
                k += 1
            T, n = Ts[k], face_normals[f]
            a = T[0, 0] * n[0] + T[0, 1] * n[1] + T[0, 2] * n[2]
            b = T[1, 0] * n[0] + T[1, 1] * n[1] + T[1, 2] * n[2]
            c = T[2, 0] * n[0] + T[2, 1] * n[1] + T[2, 2] * n[2]
            side = -1.0 if a * (u - cx) / fx + b * (v - cy) / fy + c > 0.0 else 1.0
            normals[v, u, 0], normals[v, u, 1], normals[v, u, 2] = side * a, side * b, side * c
            d = np.float64(observed[v, u, 3])
            other = np.float64(placed[v, u]) if placed.shape[0] > 0 else 0.0
            kind = classify(d, z, other, (own[k, v, u] & OWN) != 0, is_own, tau)
            classes[v, u] = kind + 1
            if pixels == PUBLISHED:
                fits = is_any
            elif pixels == OBSERVED:
                fits = is_own
            else:
                fits = kind == EXPLAINED
                counted[v, u] = fits or kind in (MISSED, PROTRUDING)
            if d > 0.0:
                difference[v, u] = d - z
            depth_fit = max(0.0, 1.0 - abs(d - z) / tau) if fits else 0.0
            f_d[v, u] = depth_fit
            dot, has_normal = 0.0, False
            for i in range(3):
                x = np.float64(observed[v, u, i])
                dot += x * np.float64(normals[v, u, i])
                has_normal = has_normal or x != 0.0
            dot = min(max(dot, 0.0), 1.0)
            if has_normal:
                angle[v, u] = math.acos(dot)
            if fits:
                without = pixels != PUBLISHED and not has_normal
                f_n[v, u] = depth_fit if without else max(0.0, 1.0 - (1.0 - dot) / alpha)
