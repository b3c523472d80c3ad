"""Draws an object in a pose in a small image, and measures how much of the depth lies there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask, writable
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Problem
from verefine_viz.rendering.mesh import RenderMesh, render_mesh
from verefine_viz.rendering.rasterizer import draw_depth

TRUTH = "ground truth"
MOST, ROWS = 5, 160
"""Most objects that are checked, those with the largest masks; and rows of the image in which they are drawn."""
NEAR_M, NEAR, NEAR_INITIAL = 0.015, 0.06, 0.3
"""Distance from a model within which depth is its own: least [m], as a share of its diameter, and as such a share at an
initial pose, which may be off."""
NEAR_AWAY = 0.02
"""Share of the distance by which depth may be off."""
FEWEST_PX = 12
"""Fewest pixels of a mask, in the smaller image, that are evidence."""


@lru_cache(maxsize=64)
def mesh_of(model: ObjectModel, times: float = 1.0) -> RenderMesh:
    """The mesh of a model enlarged by ``times``, to be drawn."""
    return render_mesh(times * model.vertices, model.faces)


@lru_cache(maxsize=64)
def _length_m(model: ObjectModel) -> float:
    """Distance from one end of a model's mesh to the other [m]."""
    from_middle = np.linalg.norm(model.vertices - model.vertices.mean(axis=0), axis=1)
    end = model.vertices[int(from_middle.argmax())]
    return float(np.linalg.norm(model.vertices - end, axis=1).max())


@dataclass(frozen=True, eq=False)
class Seen:
    """An object at a pose in a frame, in a smaller image."""

    instance_id: int
    name: str
    model: ObjectModel
    T_cam_obj: Float
    """The pose (4, 4) that is checked."""
    source: str
    """Origin of the pose: "ground truth", or an estimator."""
    mask: Mask
    """(h, w)."""
    depth_m: NDArray[np.float32]
    """(h, w), 0 = nothing was measured."""
    rays: Float
    """(h, w) length of the ray of each pixel that reaches z = 1."""
    K: Float
    """(3, 3) of the smaller image."""
    near: float
    """Distance from the model within which depth is its own, as a share of the diameter."""
    model_times: float = 1.0
    """Factor by which its model is enlarged."""

    @property
    def is_truth(self) -> bool:
        """Whether its pose is the true one, not an estimate."""
        return self.source == TRUTH

    @property
    def diameter_m(self) -> float:
        """Diameter of the enlarged mesh [m]; the one that a data set states may be wrong too."""
        return _length_m(self.model) * self.model_times

    @cached_property
    def away_m(self) -> float:
        """Median depth in the mask [m]; 0 where nothing was measured."""
        measured = self.depth_m[self.mask & (self.depth_m > 0)]
        return float(np.median(measured)) if len(measured) else 0.0

    @cached_property
    def covered_m(self) -> float:
        """Length of the mask along its longer axis, at the depth measured in it [m]; without its outermost pixels."""
        v, u = np.nonzero(self.mask)
        if len(v) < 2:
            return 0.0
        places = np.stack([u / self.K[0, 0], v / self.K[1, 1]], axis=1)
        along = (places - places.mean(axis=0)) @ np.linalg.eigh(np.cov(places.T))[1][:, -1]
        return float(np.ptp(np.percentile(along, (5, 95)))) * self.away_m

    @property
    def size(self) -> float:
        """Length of its mask as a share of the diameter: at most about 1, whatever the pose, if both are right."""
        return self.covered_m / self.diameter_m

    @property
    def near_m(self) -> float:
        """Distance from the model within which depth is its own [m]; limited by the length of the mask."""
        return max(NEAR_M, self.near * min(self.diameter_m, self.covered_m), NEAR_AWAY * self.away_m)

    def drawn_m(self) -> NDArray[np.float32]:
        """Depth (h, w) of the model drawn in its pose [m], 0 beside it."""
        out = np.zeros(self.mask.shape, np.float32)
        mesh = mesh_of(self.model, self.model_times)
        fx, fy, cx, cy = (float(self.K[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
        draw_depth(writable(self.T_cam_obj), *mesh.arrays, fx, fy, cx, cy, out)
        return out

    def fit(self) -> float:
        """Share of the pixels of mask and drawing that both have and where depth is the model's.

        Pixels without depth count like those with depth: the same share of them lies near, or is hidden.
        """
        drawn_m = self.drawn_m()
        drawn, measured = drawn_m > 0, self.depth_m > 0
        both, beside = self.mask & drawn, drawn & ~self.mask
        near = _share(np.abs(drawn_m - self.depth_m) < self.near_m, both & measured)
        hidden = _share(self.depth_m < drawn_m - self.near_m, beside & measured)
        n_both, n_beside = np.count_nonzero(both), np.count_nonzero(beside)
        return near * n_both / max(np.count_nonzero(self.mask) + (1 - hidden) * n_beside, 1)

    def error_m(self) -> float:
        """Median difference of measured and drawn depth [m] where both exist; infinite where they nowhere do."""
        drawn_m = self.drawn_m()
        both = self.mask & (drawn_m > 0) & (self.depth_m > 0)
        return float(np.median(np.abs(drawn_m - self.depth_m)[both])) if both.any() else np.inf

    def depth_ratio(self) -> float:
        """Median of measured over drawn depth where both exist; NaN where they nowhere do."""
        drawn_m = self.drawn_m()
        both = self.mask & (drawn_m > 0) & (self.depth_m > 0)
        return float(np.median(self.depth_m[both] / drawn_m[both])) if both.any() else float("nan")

    def agreement(self) -> float:
        """Share of the drawn pixels with depth where it is the model's, whatever the mask."""
        drawn_m = self.drawn_m()
        is_near = np.abs(drawn_m - self.depth_m) < max(NEAR_M, NEAR * self.diameter_m)
        return _share(is_near, (drawn_m > 0) & (self.depth_m > 0))

    def beside_scaled(self) -> float:
        """Share of the mask outside of the drawing, once the drawing has the same area and the same middle."""
        n_drawn = max(np.count_nonzero(self.drawn_m()), 1)
        times = self.model_times * np.sqrt(np.count_nonzero(self.mask) / n_drawn)
        drawn = replace(self, model_times=float(times)).drawn_m() > 0
        if not drawn.any():
            return 1.0
        down, right = (np.mean(np.nonzero(self.mask), axis=1) - np.mean(np.nonzero(drawn), axis=1)).round().astype(int)
        return _share(~np.roll(drawn, (down, right), axis=(0, 1)), self.mask)

    def is_elsewhere(self) -> bool:
        """Whether its pose is further from the depth in the mask than the model is large."""
        v, u = np.nonzero(self.mask & (self.depth_m > 0))
        pixel = np.array([np.median(u), np.median(v), 1.0])
        middle_cam = (
            self.T_cam_obj[:3, :3] @ (self.model_times * self.model.vertices.mean(axis=0)) + self.T_cam_obj[:3, 3]
        )
        seen_cam = self.away_m * np.linalg.solve(self.K, pixel)
        return float(np.linalg.norm(middle_cam - seen_cam)) > self.diameter_m

    def n_borders(self) -> int:
        """Number of image borders that its mask reaches; the object may go on beyond them."""
        edges = (self.mask[0], self.mask[-1], self.mask[:, 0], self.mask[:, -1])
        return sum(bool(edge.any()) for edge in edges)


def seen_objects(problem: Problem, poses: Mapping[int, Float], source: str) -> list[Seen]:
    """The objects of a frame with these T_cam_obj (4, 4), by instance_id, those with the largest masks."""
    observation = problem.observation
    step = max(1, observation.camera.height // ROWS)
    depth_m = np.ascontiguousarray(observation.depth_m[::step, ::step], np.float32)
    K = observation.camera.K.copy()
    K[:2] /= step
    v, u = np.indices(depth_m.shape)
    rays = np.sqrt(1 + ((u - K[0, 2]) / K[0, 0]) ** 2 + ((v - K[1, 2]) / K[1, 1]) ** 2)
    largest = sorted(problem.instances, key=lambda i: -int(np.count_nonzero(i.mask)))
    near = NEAR if source == TRUTH else NEAR_INITIAL
    seen = []
    for instance in largest[:MOST]:
        T, mask = poses.get(instance.instance_id), np.ascontiguousarray(instance.mask[::step, ::step])
        if T is not None and np.count_nonzero(mask & (depth_m > 0)) >= FEWEST_PX:
            model = problem.models[instance.obj_id]
            seen.append(Seen(instance.instance_id, model.name, model, T, source, mask, depth_m, rays, K, near))
    return seen


def _share(of: Mask, among: Mask) -> float:
    """Share of the pixels ``among`` that are in ``of`` as well; 0 without any."""
    n = np.count_nonzero(among)
    return np.count_nonzero(of & among) / n if n else 0.0
