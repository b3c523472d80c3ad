"""What ground truth says about a frame: what should have been seen, where depth is, and what carries the objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import apply
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.diagnosis.plane import carrying_plane
from verefine_viz.diagnosis.registration import Registration, registration
from verefine_viz.rendering.mesh import render_mesh
from verefine_viz.rendering.rasterizer import draw_frame

HIDDEN_M = 0.015
"""Something measured nearer than the true surface by more than this hides it [m]."""


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """All instances of a frame where they really were."""

    problem: Problem

    @cached_property
    def placed(self) -> Mapping[int, Placed]:
        """By instance_id; those with ground truth."""
        return {
            t.instance.instance_id: Placed(t.instance.instance_id, t.model, t.instance.T_cam_obj_gt)
            for t in self.problem.targets
            if t.instance.T_cam_obj_gt is not None
        }

    @cached_property
    def _rendered(self) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Z (H, W) [m] of all of them, and whose it is (instance_id, -1 elsewhere)."""
        camera = self.problem.observation.camera
        pinhole = camera.fx, camera.fy, camera.cx, camera.cy
        inv_z, owner = np.zeros(camera.shape, np.float32), np.full(camera.shape, -1, np.int32)
        for instance_id, placed in self.placed.items():
            mesh = render_mesh(placed.model.vertices, placed.model.faces)
            face_of = np.full(camera.shape, -1, np.int32)
            draw_frame(np.ascontiguousarray(placed.T_cam_obj), *mesh.arrays, *pinhole, inv_z, face_of)
            owner[face_of >= 0] = instance_id
        return np.divide(1.0, inv_z, out=np.zeros_like(inv_z), where=inv_z > 0), owner

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """(H, W) what a perfect sensor would see of the instances [m]; 0 elsewhere."""
        return self._rendered[0]

    @cached_property
    def registration(self) -> Registration:
        """How the observed depth lies on the true one."""
        return registration(self.problem.observation.depth_m, self.depth_m)

    @cached_property
    def observed_m(self) -> NDArray[np.float32]:
        """(H, W) the observed depth, put right where it was shifted or scaled [m]."""
        depth_m = self.problem.observation.depth_m
        return self.registration.undone(depth_m) if self.registration.is_off else depth_m

    def outline(self, instance_id: int) -> Mask:
        """(H, W) where the instance really is seen: its rendering, less what something nearer hides."""
        nearer = (self.observed_m > 0) & (self.observed_m < self.depth_m - HIDDEN_M)
        return (self._rendered[1] == instance_id) & ~nearer

    @cached_property
    def support(self) -> Support | None:
        """The plane that the instances really stand on; None where it cannot be told."""
        vertices = [apply(p.T_cam_obj, p.model.vertices) for p in self.placed.values()]
        if not vertices:
            return None
        observation = self.problem.observation
        is_object = binary_dilation(observation.object_mask | (self.depth_m > 0), iterations=3)
        depth_m = np.where(is_object, 0.0, self.observed_m)
        background: Float = observation.camera.back_project(depth_m)[depth_m > 0]
        return carrying_plane(np.concatenate(vertices), background)
