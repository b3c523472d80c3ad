"""Depth images of tilted planes, by formula."""

from __future__ import annotations

import numpy as np

from verefine_viz.core.camera import Camera

CAMERA = Camera(np.array([[600.0, 0, 159.5], [0, 600.0, 119.5], [0, 0, 1]]), 320, 240)


def tilted(tilt_deg: float, direction_deg: float, distance_m: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    """Depth (H, W) [m] of a plane whose normal (3,), returned too, leans ``tilt_deg`` off the optical axis."""
    tilt, direction = np.deg2rad(tilt_deg), np.deg2rad(direction_deg)
    normal = np.array([np.sin(tilt) * np.cos(direction), np.sin(tilt) * np.sin(direction), -np.cos(tilt)])
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    return -distance_m * np.cos(tilt) / (rays @ normal), normal


def angles_deg(normals: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Angles (n,) between the non-zero ones of ``normals`` (…, 3) and ``normal`` (3,)."""
    known = normals[(normals != 0).any(axis=-1)]
    return np.rad2deg(np.arccos(np.clip(known @ normal, -1, 1)))
