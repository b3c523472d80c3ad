"""A frame that a pipeline kept, and what it looks like in BOP's files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.scenes.meshes import Mesh
from verefine_viz.scenes.ply import ply_bytes, size_entry


@dataclass(frozen=True, eq=False)
class KeptObject:
    """An object of a frame, its arrays checked."""

    name: str
    mesh: Mesh
    mask: Mask
    poses: Mapping[str, Sequence[Float]]
    """(4, 4) each [m], by estimator, best first."""
    T_cam_obj_gt: Float | None
    symmetry_axis: Float | None
    """(3,) of any length, through the middle of the mesh's box."""


@dataclass(frozen=True, eq=False)
class KeptFrame:
    """A frame, its arrays checked."""

    K: Float
    depth_m: Float
    """(H, W) [m], 0 where nothing was measured, at most 60 m."""
    rgb: NDArray[np.uint8] | None
    objects: Sequence[KeptObject]
    down_cam: Float | None
    """(3,) where things fall, of any length."""


def ply_of(mesh: Mesh) -> bytes:
    """A mesh as it lies in ``models``."""
    return ply_bytes(mesh.vertices_m, mesh.faces, mesh.vertex_colors)


def info_entry(one: KeptObject) -> dict[str, Any]:
    """What ``models_info.json`` says of an object."""
    entry = size_entry(one.mesh.vertices_m, one.mesh.diameter_m)
    if one.symmetry_axis is not None:
        low, high = one.mesh.vertices_m.min(axis=0), one.mesh.vertices_m.max(axis=0)
        axis = one.symmetry_axis / np.linalg.norm(one.symmetry_axis)
        entry["symmetries_continuous"] = [{"axis": axis.tolist(), "offset": (500 * (low + high)).tolist()}]
    return entry


def truth_entry(T_cam_obj_gt: Float, obj_id: int) -> dict[str, Any]:
    """What ``scene_gt.json`` says of an object whose true pose (4, 4) [m] is known."""
    t_mm = (T_cam_obj_gt[:3, 3] * 1e3).tolist()
    return {"cam_R_m2c": T_cam_obj_gt[:3, :3].ravel().tolist(), "cam_t_m2c": t_mm, "obj_id": obj_id}


def camera_entry(frame: KeptFrame, step_mm: float) -> dict[str, Any]:
    """What ``scene_camera.json`` says of a frame whose depth image counts in steps of ``step_mm`` [mm]."""
    entry: dict[str, Any] = {"cam_K": frame.K.ravel().tolist(), "depth_scale": step_mm}
    if frame.down_cam is not None:
        entry["cam_R_w2c"] = _R_cam_world(frame.down_cam).ravel().tolist()
    return entry


def _R_cam_world(down_cam: Float) -> Float:
    """(3, 3) for a world whose z is up; where its x points is of no matter."""
    up = -down_cam / np.linalg.norm(down_cam)
    side = np.cross(np.eye(3)[int(np.argmin(np.abs(up)))], up)
    side /= np.linalg.norm(side)
    return np.column_stack([side, np.cross(up, side), up])
