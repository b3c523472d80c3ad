"""The surfaces that support objects in a depth image: planes, each as far as the image does not show it to end.

A surface goes on where nothing was measured, below the objects and behind them, and ends where the camera looks through
it at something lower. So it is convex, may be as thick as what is seen below it allows, and pushes up what starts deep
inside of it, as the plane of the paper does. docs/methods.md 7.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import ConvexHull, KDTree, QhullError

from verefine_viz.core.arrays import Float
from verefine_viz.core.surroundings import SupportSurface, clipped

CELL_M = 0.005
"""Side of a cell, seen from above [m]."""
ON_M = 0.004
"""A cell no further from a plane lies on it [m]: three times the noise of a cell's mean on a table at 1 m."""
LOWER_M = 0.012
"""What is seen this far below a plane is seen through a gap in the surface, or past its end [m]."""
STEEPEST = np.cos(np.radians(40.0))
"""Upward part of the normal below which nothing stays on a surface [-]."""
FEWEST_CELLS = 40
"""A smaller surface is none: 10 cm², as the rim of a box around what stands on it."""
MOST_SURFACES = 8
N_SEEDS = 60
"""Places at which another surface is looked for."""
SEED_M = 0.03
"""Radius of what a surface is first fitted to [m]."""
ENDS = 3
"""So many cells in a gap, of as many points each, end a surface; fewer are outliers."""
MOST_INSIDE = 0.03
"""Share of the cells within an outline that may be gaps."""
FAR_M = 1.0
"""Where the outline of the first surface ends that nothing else ends [m]."""
GOES_ON_M = 0.10
"""How far another surface goes on where nothing ends it [m]."""


@dataclass(frozen=True, eq=False)
class HeightCells:
    """Where the image shows upward surfaces, seen from above: the highest per cell."""

    tops: Float
    """(n, 3) [m], world."""
    at: NDArray[np.int64]
    """(n, 2) row and column of each in the grid."""
    shape: tuple[int, int]


def cells_of(points: Float, low: Float, high: Float, cell_m: float) -> HeightCells:
    """The cells of points (n, 3) of upward surfaces between ``low`` and ``high`` (2,).

    A cell's top is the mean of what lies close to its highest points, a few outliers aside.
    """
    shape = tuple(int(n) for n in np.maximum(np.ceil((high - low) / cell_m), 1))
    at = np.floor((points[:, :2] - low) / cell_m).astype(np.int64)
    inside = ((at >= 0) & (at < shape)).all(axis=1)
    points, at = points[inside], at[inside]
    flat = at[:, 0] * shape[1] + at[:, 1]
    order = np.lexsort((points[:, 2], flat))
    points, flat = points[order], flat[order]
    cells, first, count = np.unique(flat, return_index=True, return_counts=True)
    high_z = points[first + (0.9 * (count - 1)).astype(np.int64), 2]
    of = np.repeat(np.arange(len(cells)), count)
    near = np.abs(points[:, 2] - high_z[of]) <= 2 * ON_M
    n_near = np.bincount(of[near], minlength=len(cells))
    sums = [np.bincount(of[near], points[near, k], minlength=len(cells)) for k in range(3)]
    dense = n_near >= 3
    tops = np.stack(sums, axis=1)[dense] / n_near[dense, None]
    at = np.stack([cells // shape[1], cells % shape[1]], axis=1)[dense]
    return HeightCells(tops, at, (shape[0], shape[1]))


def support_surfaces(cells: HeightCells, seen: Float, eye: Float, first: SupportSurface) -> tuple[SupportSurface, ...]:
    """The surfaces of the cells, that of ``first`` (the support plane) before others, then the largest first.

    Only the first may be endless.

    Args:
        cells: of the image, without the objects.
        seen: points (m, 3) of the whole image: a surface ends before the rays to those that are lower.
        eye: (3,) the camera.
        first: where the first is looked for.
    """
    surfaces: list[SupportSurface] = []
    left = np.ones(len(cells.tops), dtype=bool)
    candidate: SupportSurface | None = first
    while candidate is not None and len(surfaces) < MOST_SURFACES:
        fitted = _fitted(candidate, cells.tops[left])
        far_m = FAR_M if candidate is first else GOES_ON_M
        outlined = (
            _outlined(fitted, cells, left, _seen_through(fitted, seen, eye), far_m) if fitted is not None else None
        )
        if candidate is first and outlined is None:
            outlined = fitted or first
        if outlined is not None:
            surfaces.append(outlined)
            left &= ~(outlined.reaches(cells.tops[:, :2], CELL_M) & (np.abs(outlined.heights(cells.tops)) <= ON_M))
        candidate = _another(cells.tops, left) if outlined is not None else None
    return tuple(surfaces)


def _another(tops: Float, left: NDArray[np.bool_]) -> SupportSurface | None:
    """The plane through a patch of the cells ``left`` on which most of them lie; None where too few do."""
    rest = np.flatnonzero(left)
    if len(rest) < FEWEST_CELLS:
        return None
    points = tops[rest]
    tree = KDTree(points[:, :2])
    best, most = None, FEWEST_CELLS - 1
    for seed in points[np.linspace(0, len(points) - 1, N_SEEDS).astype(int)]:
        patch = points[tree.query_ball_point(seed[:2], SEED_M, return_sorted=True)]
        patch = patch[np.abs(patch[:, 2] - seed[2]) <= SEED_M]
        plane = _plane(patch) if len(patch) >= FEWEST_CELLS // 4 else None
        if plane is not None and plane.normal_world[2] >= STEEPEST:
            n = int(np.count_nonzero(np.abs(plane.heights(points)) <= ON_M))
            best, most = (plane, n) if n > most else (best, most)
    return best


def _plane(points: Float) -> SupportSurface:
    """The plane of least squares, endless."""
    centre = points.mean(axis=0)
    normal = np.linalg.eigh((points - centre).T @ (points - centre))[1][:, 0]
    normal = normal if normal[2] >= 0 else -normal
    return SupportSurface(normal, float(-normal @ centre), np.zeros((0, 2)))


def _fitted(plane: SupportSurface, points: Float) -> SupportSurface | None:
    """The plane of the points near it, fitted a few times ever more narrowly; None where it loses them."""
    for within_m in (2 * ON_M, 2 * ON_M, ON_M, ON_M):
        near = points[np.abs(plane.heights(points)) <= within_m]
        if len(near) < FEWEST_CELLS:
            return None
        plane = _plane(near)
    return plane if plane.normal_world[2] >= STEEPEST else None


def _outlined(
    plane: SupportSurface, cells: HeightCells, left: NDArray[np.bool_], gaps: Float, far_m: float
) -> SupportSurface | None:
    """The plane with the outline within which it supports, clear of the ``gaps`` (n, 2) in it; None where that is too
    small.
    """
    heights = plane.heights(cells.tops)
    on = left & (np.abs(heights) <= ON_M)
    grid = np.zeros(cells.shape, dtype=bool)
    grid[tuple(cells.at[on].T)] = True
    labels = np.zeros(cells.shape, dtype=np.int32)
    ndimage.label(ndimage.binary_dilation(grid, np.ones((5, 5))), np.ones((3, 3)), output=labels)
    own = labels[tuple(cells.at.T)]
    sizes = np.bincount(own[on], minlength=1)
    sizes[0] = 0
    on &= own == int(sizes.argmax())
    xy = cells.tops[:, :2]
    # Where gaps lie inside, the outline is that of fewer cells around the middle.
    for _ in range(5):
        if np.count_nonzero(on) < FEWEST_CELLS:
            return None
        hull = _hull(xy[on])
        if hull is None:
            return None
        beyond = gaps @ hull.equations[:, :2].T + hull.equations[:, 2]
        n_inside = np.count_nonzero(beyond.max(axis=1, initial=-np.inf) < -2 * CELL_M)
        if n_inside <= MOST_INSIDE * np.count_nonzero(on):
            return SupportSurface(plane.normal_world, plane.offset_m, _ended(hull, beyond, far_m))
        middle = np.median(xy[on], axis=0)
        away = np.linalg.norm(xy - middle, axis=1)
        on &= away <= np.quantile(away[on], 0.6)
    return None


def _seen_through(plane: SupportSurface, seen: Float, eye: Float) -> Float:
    """Middles (m, 2) of the cells in which the camera looks through the plane at something lower."""
    eye_m, heights = float(plane.heights(eye[None])[0]), plane.heights(seen)
    lower, below_m = seen[heights < -LOWER_M, :2], -heights[heights < -LOWER_M]
    xy = eye[:2] + (lower - eye[:2]) * (eye_m / (eye_m + below_m))[:, None] if eye_m > 0 else lower
    cells, count = np.unique(np.floor(xy / CELL_M), axis=0, return_counts=True)
    return (cells[count >= ENDS] + 0.5) * CELL_M


def _hull(xy: Float) -> ConvexHull | None:
    try:
        return ConvexHull(xy)
    except QhullError:
        return None


def _ended(hull: ConvexHull, beyond: Float, far_m: float) -> Float:
    """The outline (m, 2), anticlockwise: the edges of ``hull`` beyond which there are gaps, and ``far_m`` beyond the
    hull elsewhere; none where it is far and ends nowhere.

    Args:
        hull: of the cells on the surface.
        beyond: (n, e) how far each gap is beyond each of its edges [m].
        far_m: see above.
    """
    beyond = beyond[beyond.max(axis=1, initial=-np.inf) > -2 * CELL_M]
    nearest_edge = beyond.argmax(axis=1)
    ends = np.bincount(nearest_edge, minlength=len(hull.equations)) >= ENDS
    if far_m == FAR_M and not ends.any():
        return np.zeros((0, 2))
    (x, y), (u, v) = hull.points.min(axis=0) - far_m, hull.points.max(axis=0) + far_m
    outline = np.array([[x, y], [u, y], [u, v], [x, v]])
    for k in np.flatnonzero(ends):
        # The first surface goes on to where the gap begins; others may be the rim of something.
        first_m = float(np.sort(beyond[nearest_edge == k, k])[ENDS - 1]) if far_m == FAR_M else 0.0
        offset = float(hull.equations[k, 2]) - max(first_m - CELL_M / 2, CELL_M / 2)
        outline = clipped(outline, hull.equations[k, :2], offset)
    return outline
