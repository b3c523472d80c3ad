"""What is seen of each instance: its own pixels, their points, and how high they lie over the support plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label as label_components
from scipy.ndimage import maximum_filter, minimum_filter

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import apply, transform
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Problem

MOST_POINTS = 5000
"""Points per instance that are used; denser clouds are thinned evenly, to about 1 mm in a near view."""
STEP = 0.015
"""A pixel next to a step in depth larger than this share of its depth may belong to either side."""
SLIVER = 0.05
"""A component of less than this share of an instance, cut off by a step in depth, does not count as part of it."""
Box = tuple[slice, slice]
"""Rows and columns of a picture."""


@dataclass(frozen=True, eq=False)
class VisiblePart:
    """One instance as the sensor saw it."""

    instance_id: int
    name: str
    """For texts: "mug (#4)"."""
    pixels: Mask
    """(H, W) of its mask, without those that another mask claims too."""
    box: Box
    """The smallest that holds ``pixels``."""
    points_cam: Float
    """(N, 3) [m], N ≥ 1."""
    bounds_cam: tuple[Float, Float]
    """Least and greatest coordinates (3,) of ``points_cam``."""
    points_plane: Float | None
    """(N, 3) the same in a frame whose x and y lie in the support plane and whose z is the height over it [m]; None
    where there is no plane."""
    median_depth_m: float

    @property
    def heights_m(self) -> Float:
        """(N,) over the support plane, which must be there."""
        assert self.points_plane is not None
        return self.points_plane[:, 2]


def visible_parts(problem: Problem) -> tuple[VisiblePart, ...]:
    """The instances of which something was measured, by instance_id."""
    depth_m, camera = problem.observation.depth_m, problem.observation.camera
    is_measured = depth_m > 0
    support = problem.observation.support
    T_plane_cam = None if support is None else _plane_frame(support)
    instances = sorted(problem.instances, key=lambda i: i.instance_id)
    parts = []
    for instance, pixels in zip(instances, _own_pixels([i.mask for i in instances]), strict=True):
        box = _box(pixels & is_measured)
        if box is None:
            continue
        v, u = np.nonzero(_without_strays(pixels[box], depth_m[box]))
        v, u = v + box[0].start, u + box[1].start
        z = depth_m[v, u].astype(np.float64)
        chosen = slice(None, None, -(-len(v) // MOST_POINTS))
        points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)[chosen]
        parts.append(
            VisiblePart(
                instance.instance_id,
                label(problem, instance.instance_id),
                pixels,
                box,
                points,
                _bounds(points),
                None if T_plane_cam is None else apply(T_plane_cam, points),
                float(np.median(z)),
            )
        )
    return tuple(parts)


def label(problem: Problem, instance_id: int) -> str:
    """An instance in texts: "mug (#4)"."""
    instance = next(i for i in problem.instances if i.instance_id == instance_id)
    return f"{problem.models[instance.obj_id].name} (#{instance_id})"


def _box(pixels: Mask) -> Box | None:
    """The smallest box that holds all pixels; None without any."""
    rows, columns = np.flatnonzero(pixels.any(axis=1)), np.flatnonzero(pixels.any(axis=0))
    if len(rows) == 0:
        return None
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _bounds(points: Float) -> tuple[Float, Float]:
    # Column by column: numpy takes ten times as long along the long axis of (N, 3).
    columns = [np.ascontiguousarray(points[:, k]) for k in range(3)]
    return np.array([c.min() for c in columns]), np.array([c.max() for c in columns])


def _own_pixels(masks: Sequence[Mask]) -> list[Mask]:
    """Each mask without the pixels that it shares with others, as it is unknown whose depth they have.

    A mask of which less than half would stay is left whole.
    """
    if not masks:
        return []
    claims = np.sum(masks, axis=0, dtype=np.uint8)
    if claims.max(initial=0) < 2:
        return list(masks)
    alone = [mask & (claims == 1) for mask in masks]
    return [own if 2 * np.count_nonzero(own) >= np.count_nonzero(m) else m for own, m in zip(alone, masks, strict=True)]


def _without_strays(pixels: Mask, depth_m: NDArray[np.floating]) -> Mask:
    """Measured pixels without those at steps in depth and without slivers behind one: a mask's border leaks.

    A leak of two pixels onto what stands behind makes two things touch that do not, and a footprint reach under both.
    All measured pixels stay where less than half would.
    """
    measured = pixels & (depth_m > 0)
    farthest = maximum_filter(np.where(measured, depth_m, 0), 3)
    nearest = minimum_filter(np.where(measured, depth_m, np.inf), 3)
    smooth = measured & (farthest - nearest <= STEP * depth_m)
    components = np.zeros(smooth.shape, dtype=np.int32)
    label_components(smooth, output=components)
    sizes = np.bincount(components.ravel())
    is_large = sizes >= SLIVER * np.count_nonzero(smooth)
    is_large[0] = False
    own = is_large[components]
    return own if 2 * np.count_nonzero(own) >= np.count_nonzero(measured) else measured


def _plane_frame(support: Support) -> Float:
    """T_plane_cam: x and y in the support plane, z up from it."""
    z = support.normal_world / np.linalg.norm(support.normal_world)
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    x /= np.linalg.norm(x)
    return transform(np.stack([x, np.cross(z, x), z]), np.zeros(3)) @ support.T_world_cam
