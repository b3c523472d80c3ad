"""Which pixels a model covers under a pose, and its depth there; no colour, no normals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed
from verefine_viz.rendering.mesh import RenderMesh, render_mesh
from verefine_viz.rendering.rasterizer import draw_frame


def silhouette(model: ObjectModel, T_cam_obj: Float, camera: Camera) -> Mask:
    """The pixels (H, W) on which the model appears, its holes left open."""
    inv_z = np.zeros(camera.shape, np.float32)
    face_of = np.full(camera.shape, -1, np.int32)
    _draw(render_mesh(model.vertices, model.faces), T_cam_obj, camera, inv_z, face_of)
    return face_of >= 0


def depth_of(placed: Sequence[Placed], camera: Camera) -> Float:
    """The depth (H, W) [m] that posed models have together, 0 beside them."""
    inv_z = np.zeros(camera.shape, np.float32)
    face_of = np.full(camera.shape, -1, np.int32)
    meshes: dict[int, RenderMesh] = {}  # by identity: a model may be placed thousands of times
    for one in placed:
        if id(one.model) not in meshes:
            meshes[id(one.model)] = render_mesh(one.model.vertices, one.model.faces)
        _draw(meshes[id(one.model)], one.T_cam_obj, camera, inv_z, face_of)
    return np.divide(1.0, inv_z, out=np.zeros_like(inv_z), where=inv_z > 0).astype(np.float64)


def _draw(
    mesh: RenderMesh, T_cam_obj: Float, camera: Camera, inv_z: NDArray[np.float32], face_of: NDArray[np.int32]
) -> None:
    pinhole = camera.fx, camera.fy, camera.cx, camera.cy
    draw_frame(np.ascontiguousarray(T_cam_obj), *mesh.arrays, *pinhole, inv_z, face_of)


def overlap(a: Mask, b: Mask) -> float:
    """Intersection over union of two masks, in [0, 1]; 0 where both are empty."""
    union = np.count_nonzero(a | b)
    return np.count_nonzero(a & b) / union if union else 0.0


def best_owner(outline: Mask, masks: Sequence[Mask]) -> int:
    """Index of the mask that an outline overlaps most; of the nearest one where it overlaps none."""
    shares = [overlap(outline, mask) for mask in masks]
    if max(shares) > 0:
        return int(np.argmax(shares))
    centres = [_centre(mask) for mask in masks]
    return int(np.argmin([np.linalg.norm(_centre(outline) - c) for c in centres]))


def _centre(mask: Mask) -> Float:
    """Mean (v, u) of a mask [px]; the image's middle where it is empty."""
    v, u = np.nonzero(mask)
    return np.array([v.mean(), u.mean()]) if len(v) else np.array(mask.shape) / 2
