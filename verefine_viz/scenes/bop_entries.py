"""What a data set in BOP layout is written of: entries of its JSON files, depth images, models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.scenes.meshes import Mesh
from verefine_viz.trace import ply_bytes

DEPTH_STEPS_MM = (0.1, 1.0)
"""Millimetres per step of the 16-bit depth images: the first in which the frame fits."""
FARTHEST_M = 60.0
"""Depth beyond counts as not measured."""


def depth_image(depth_m: Float) -> tuple[NDArray[np.uint16], float]:
    """The values of a depth image (H, W) [m], at most ``FARTHEST_M``, and what a step of them is [mm]."""
    step_mm = next(step for step in DEPTH_STEPS_MM if depth_m.max() * 1e3 / step < 65535)
    return np.round(depth_m * 1e3 / step_mm).astype(np.uint16), step_mm


def truth_entry(T_cam_obj: Float | None, obj_id: int) -> dict[str, Any]:
    """Entry of an object in ``scene_gt.json``; without a pose where it is unknown, as the file says what is there."""
    if T_cam_obj is None:
        return {"obj_id": obj_id}
    t_mm = (T_cam_obj[:3, 3] * 1e3).tolist()
    return {"cam_R_m2c": T_cam_obj[:3, :3].ravel().tolist(), "cam_t_m2c": t_mm, "obj_id": obj_id}


def camera_entry(K: Float, step_mm: float, down_cam: Float | None) -> dict[str, Any]:
    """Entry of a frame in ``scene_camera.json``.

    Args:
        K: (3, 3) camera matrix [px].
        step_mm: what a step of its depth image is [mm].
        down_cam: (3,) where things fall, of any length; None where that is not known.
    """
    entry: dict[str, Any] = {"cam_K": K.ravel().tolist(), "depth_scale": step_mm}
    if down_cam is not None:
        entry["cam_R_w2c"] = _R_cam_world(down_cam).ravel().tolist()
    return entry


def model_file(mesh: Mesh, texture: Path) -> bytes:
    """The content of a model's PLY file, whose texture, where it has one, is the image ``texture`` beside it."""
    skin = None if mesh.texture is None else (texture.name, mesh.texture.uv)
    return ply_bytes(1e3 * mesh.vertices_m, mesh.faces, mesh.vertex_colors, skin)


def _R_cam_world(down_cam: Float) -> Float:
    """(3, 3) for a world whose z is up; where its x points does not matter."""
    up = -down_cam / np.linalg.norm(down_cam)
    side = np.cross(np.eye(3)[int(np.argmin(np.abs(up)))], up)
    side /= np.linalg.norm(side)
    return np.column_stack([side, np.cross(up, side), up])
