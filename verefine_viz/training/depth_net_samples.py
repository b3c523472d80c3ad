"""Batches for ``depth_net``: views, each with a pose near its ground truth. Same seed and step, same batch."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, random_unit_vector, transform
from verefine_viz.learned.depth_crops import Extent, crops_at
from verefine_viz.training.synthetic_views import SyntheticView, draw_view
from verefine_viz.training.training_shapes import LOSS_POINTS

LARGEST_DEG, LARGEST_SHIFT = 60.0, 0.8
"""How far poses are from the ground truth at most [deg], [radii]: the range that a network is trained on."""
NEAR, NEAR_REACH = 0.3, 0.3
"""Share of poses that are near, and how near, as a share of those two: where the later steps of a call begin."""
VIEWS_HELD = 384
"""Views of which a batch is drawn."""
NEW_VIEWS = 2
"""Views that are replaced after each batch."""
VIEWS, STARTS, HELD_OUT = 0, 1, 2
"""What the second number of a seed stands for."""


@dataclass(frozen=True, eq=False)
class CropBatch:
    """B crops with what the network should answer."""

    crops: NDArray[np.float32]
    """(B, C, S, S)."""
    points: NDArray[np.float32]
    """(B, P, 3) points of the object at the pose, from its middle, in the crop's frame [radii]."""
    wanted: NDArray[np.float32]
    """(B, P, 3) the same points at the ground truth."""


class TrainingBatches:
    """The batches of a seed, from any step on."""

    def __init__(self, seed: int, batch_size: int, first_step: int = 0) -> None:
        self._seed, self._size, self._step = seed, batch_size, first_step
        first = first_step * NEW_VIEWS
        self._views = deque((self._view(k) for k in range(first, first + VIEWS_HELD)), maxlen=VIEWS_HELD)

    def next(self) -> CropBatch:
        """The batch of the current step; the next call gives the next step's."""
        rng = np.random.default_rng((self._seed, STARTS, self._step))
        batch = batch_of([self._views[int(k)] for k in rng.integers(VIEWS_HELD, size=self._size)], rng)
        newest = self._step * NEW_VIEWS + VIEWS_HELD
        self._views.extend(self._view(newest + k) for k in range(NEW_VIEWS))
        self._step += 1
        return batch

    def _view(self, index: int) -> SyntheticView:
        return draw_view((self._seed, VIEWS, index))


def held_out_views(n: int) -> list[SyntheticView]:
    """Views of shapes and scenes that no training sees."""
    return [draw_view((0, HELD_OUT, k), held_out=True) for k in range(n)]


def batch_of(views: list[SyntheticView], rng: np.random.Generator) -> CropBatch:
    """A batch with one pose of each view."""
    crops, points, wanted = [], [], []
    for view in views:
        T = start_near(view, rng)
        seen = crops_at(view.depth_m, view.mask, view.camera, view.shape.mesh, extent(view), T[None])
        R_crop, radius_m = seen.Rs_crop_cam[0], view.shape.radius_m
        at_pose = view.shape.points @ T[:3, :3].T
        target = nearest_equivalent(view, T)
        at_truth = view.shape.points @ target[:3, :3].T + target[:3, 3] - T[:3, 3]
        crops.append(seen.channels[0])
        points.append(at_pose @ R_crop.T / radius_m)
        wanted.append(at_truth @ R_crop.T / radius_m)
    shape = (len(views), LOSS_POINTS, 3)
    return CropBatch(np.stack(crops), *(np.array(p, np.float32).reshape(shape) for p in (points, wanted)))


def extent(view: SyntheticView) -> Extent:
    """Extent of the view's shape."""
    return Extent(np.zeros(3), view.shape.radius_m)


def start_near(view: SyntheticView, rng: np.random.Generator) -> Float:
    """A pose (4, 4) around the ground truth; every angle and every length of the shift is as likely as another."""
    reach = NEAR_REACH if rng.random() < NEAR else 1.0
    turn = axis_angle(random_unit_vector(rng), np.deg2rad(LARGEST_DEG) * reach * rng.random())
    shift = random_unit_vector(rng) * LARGEST_SHIFT * view.shape.radius_m * reach * rng.random()
    return transform(turn @ view.T_cam_obj[:3, :3], view.T_cam_obj[:3, 3] + shift)


def nearest_equivalent(view: SyntheticView, T: Float) -> Float:
    """The pose (4, 4), of those that look like the ground truth, whose rotation is nearest to that of ``T``."""
    Rs = view.T_cam_obj[:3, :3] @ view.shape.symmetries
    alike = np.einsum("ij,sij->s", T[:3, :3], Rs)
    return transform(Rs[int(alike.argmax())], view.T_cam_obj[:3, 3])
