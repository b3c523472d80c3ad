"""The colour term of the score (docs/methods.md 1.10): how well a model's colours under a pose agree with the image.

f_c is the normalised cross-correlation, zero mean, of rendered and observed colour over the explained pixels of a pose,
all channels of an opponent space together: it does not depend on gain or offset of the image.

A model's colours, of a texture or of its vertices, are averaged once in small cells of its box, so that every point of
its surface has a colour whatever mesh is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Target
from verefine_viz.core.scores import PixelGrid

OPPONENT = np.array([[1 / 6, 1 / 6, 1 / 6], [1.0, -1.0, 0.0], [0.5, 0.5, -1.0]])
"""Lightness, red-green, blue-yellow of RGB in [0, 1]. Lightness counts half: it suffers most from light and shadow."""

CELL_M = 0.002
"""Side of the cells in which a model's colours are averaged [m]: two to three pixels of a sensor at arm's length."""

MOST_CELLS = 300_000
"""Most cells of a model; a large model has larger cells."""

SIGMA_PX = 1.0
"""Width of the Gaussian that smooths the image [px], to the resolution of the cells."""

NOISE = 0.02
"""Contrast, as root mean square, that noise and rounding alone may cause."""

LEAST_CONTRAST = 0.08
"""Least contrast of a model, and of an object's image, for a colour term: light and shadow in a texture reach as
much."""

N_COLOUR_SUMS = 10
"""Sums of each model: pixels, Σa (3), Σb (3), Σa², Σb², Σab; a rendered, b observed, products over the channels."""


def opponent(rgb: NDArray[np.floating]) -> NDArray[np.floating]:
    """Colours (…, 3) in the opponent space, of RGB in [0, 1]."""
    return rgb @ OPPONENT.T


def rgb_of(colours: NDArray[np.floating]) -> NDArray[np.uint8]:
    """(…, 3) RGB of colours in the opponent space."""
    return np.clip(np.rint(255 * colours @ np.linalg.inv(OPPONENT).T), 0, 255).astype(np.uint8)


def smoothed(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return an image (H, W, 3) as the colour term compares it: blurred, in the opponent space."""
    blurred = gaussian_filter(rgb.astype(np.float32) / 255, (SIGMA_PX, SIGMA_PX, 0))
    return np.ascontiguousarray(opponent(blurred), np.float32)


@dataclass(frozen=True, eq=False)
class ColourGrid:
    """The colours of a model's surface; a cell without surface has those of the nearest cell with surface."""

    cells: NDArray[np.float32]
    """(X, Y, Z, 3) in the opponent space."""
    origin_m: Float
    """(3,) corner of the first cell [m]."""
    cell_m: float
    """Side of a cell [m]."""
    contrast: float
    """Root mean square difference to the mean colour, over the surface."""


@lru_cache(maxsize=64)
def colour_grid(model: ObjectModel) -> ColourGrid:
    """The colours of a model that has colours."""
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    corners = model.vertices[model.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    cell_m = max(CELL_M, float(np.prod(high - low + CELL_M) / MOST_CELLS) ** (1 / 3))
    shape = np.floor((high - low) / cell_m).astype(int) + 1
    # The same points at each call, several in each cell.
    rng, n = np.random.default_rng(0), int(np.clip(3 * area.sum() / cell_m**2, 20_000, 400_000))
    face = rng.choice(len(area), n, p=area / area.sum())
    r, s = np.sqrt(rng.random(n)), rng.random(n)
    weights = np.stack([1 - r, r * (1 - s), r * s], axis=1)
    points = np.einsum("ik,ikj->ij", weights, corners[face])
    colours = opponent(model.colors(face, weights) / 255)
    at = np.clip(((points - low) / cell_m).astype(int), 0, shape - 1)
    flat = np.ravel_multi_index(tuple(at.T), tuple(shape))
    count = np.bincount(flat, minlength=int(shape.prod()))
    sums = np.stack([np.bincount(flat, colours[:, k], len(count)) for k in range(3)], axis=1)
    mean = sums / np.maximum(count, 1)[:, None]
    nearest = distance_transform_edt((count == 0).reshape(shape), return_distances=False, return_indices=True)
    cells = mean.reshape(*shape, 3)[tuple(np.asarray(nearest))]
    contrast = float(np.sqrt(colours.var(axis=0).sum()))
    return ColourGrid(np.ascontiguousarray(cells, np.float32), low, cell_m, contrast)


Arrays = tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.int64], Float, Float, NDArray[np.float32]]

NO_COLOURS: Arrays = (
    np.zeros((0, 3), np.float32), np.zeros(1, np.int64), np.zeros((0, 3), np.int64), np.zeros((0, 3)), np.zeros(0),
    np.zeros((0, 0, 3), np.float32),
)  # fmt: skip
"""Arguments of the kernels where there is no colour term."""


@dataclass(frozen=True, eq=False)
class SceneColours:
    """The colours of m targets that are scored together, and of the image."""

    grids: tuple[ColourGrid | None, ...]
    """None where the term is off for a target."""
    observed: NDArray[np.float32]
    """(H, W, 3) the smoothed image, in the opponent space."""
    shares: Float
    """(m,) weight of each target in the common score: its share of the pixels in all masks; 0 where the term is off."""
    weight: float
    """w of the score: ``score.colour_weight`` times the sum of ``shares``. It does not depend on the poses."""
    arrays: Arrays
    """What the kernels take: cells (C, 3) of all models end to end, where each model's begin (m + 1,), their shape
    (m, 3), first corner (m, 3) [m] and number per metre (m,), and ``observed``."""

    def fits(self, sums: Float) -> Float:
        """f_c (N,) of N combinations from their sums (N, m, ``N_COLOUR_SUMS``)."""
        return correlations(sums) @ self.shares / max(float(self.shares.sum()), 1e-12)

    def rendered(
        self, Ts: Float, at: PixelGrid, depth_m: NDArray[np.float32], model_of: NDArray, camera: tuple[float, ...]
    ) -> NDArray[np.float32]:
        """(h, w, 3) the models' colours at the pixels of a grid, NaN where none is known.

        Args:
            Ts: (m, 4, 4) T_cam_obj.
            at: the pixels.
            depth_m: (h, w) z of the models there, 0 = empty [m].
            model_of: (h, w) index of the model that is seen there.
            camera: (fx, fy, cx, cy) [px].
        """
        fx, fy, cx, cy = camera
        out = np.full((*depth_m.shape, 3), np.nan, np.float32)
        x, y = (at.columns[None] - cx) / fx * depth_m, (at.rows[:, None] - cy) / fy * depth_m
        points_cam = np.stack([x, y, depth_m], axis=-1).astype(np.float64)
        for k, grid in enumerate(self.grids):
            seen = (depth_m > 0) & (model_of == k)
            if grid is not None and seen.any():
                points = (points_cam[seen] - Ts[k, :3, 3]) @ Ts[k, :3, :3]
                cell = ((points - grid.origin_m) / grid.cell_m).astype(int)
                out[seen] = grid.cells[tuple(np.clip(cell, 0, np.array(grid.cells.shape[:3]) - 1).T)]
        return out


@kernel()
def correlations(sums: np.ndarray) -> np.ndarray:
    """f_c in [−1, 1] of each row (…, ``N_COLOUR_SUMS``); noise counts as uncorrelated contrast."""
    out = np.zeros(sums.shape[:-1])
    for i in np.ndindex(out.shape):
        s = sums[i]
        n = max(s[0], 1.0)
        a2, b2, ab = s[7], s[8], s[9]
        for c in range(3):
            a2 -= s[1 + c] * s[1 + c] / n
            b2 -= s[4 + c] * s[4 + c] / n
            ab -= s[1 + c] * s[4 + c] / n
        noise = n * NOISE * NOISE
        out[i] = ab / np.sqrt((max(a2, 0.0) + noise) * (max(b2, 0.0) + noise))
    return out


def local_correlation(
    rendered: NDArray[np.floating], observed: NDArray[np.floating], model_of: NDArray[np.integer], sums: Float
) -> NDArray[np.float32]:
    """(h, w) the addends of f_c, whose mean over a model's explained pixels that count is its f_c; NaN elsewhere.

    Args:
        rendered: (h, w, 3) opponent space.
        observed: (h, w, 3).
        model_of: (h, w) the model that a pixel is explained by, or −1.
        sums: (m, ``N_COLOUR_SUMS``) over the whole image.
    """
    out = np.full(model_of.shape, np.nan, np.float32)
    for k, s in enumerate(sums):
        here = (model_of == k) & np.isfinite(rendered[..., 0])
        n, a, b = max(s[0], 1.0), s[1:4] / max(s[0], 1.0), s[4:7] / max(s[0], 1.0)
        spread = np.sqrt((s[7] / n - a @ a + NOISE**2) * (s[8] / n - b @ b + NOISE**2))
        out[here] = ((rendered[here] - a) * (observed[here] - b)).sum(axis=-1) / spread
    return out


CACHED_SCENES = 16
"""How many combinations of targets are cached for a frame."""

_Scene = tuple[tuple[tuple[Instance, ObjectModel], ...], SceneColours | None]


class ColourStore:
    """Smoothed images and the colours of targets, made when first asked for and cached as long as frames and targets
    live.

    Args:
        weight: ``score.colour_weight``.
    """

    def __init__(self, weight: float) -> None:
        self._weight = weight
        self._images: WeakKeyDictionary[Observation, NDArray[np.float32]] = WeakKeyDictionary()
        self._scenes: WeakKeyDictionary[Observation, dict[tuple[int, ...], _Scene]] = WeakKeyDictionary()

    def scene(self, targets: Sequence[Target]) -> SceneColours | None:
        """The colours of targets of one frame; None where the term is off for all of them."""
        if self._weight == 0 or targets[0].observation.rgb is None:
            return None
        scenes = self._scenes.setdefault(targets[0].observation, {})
        key = tuple(id(part) for target in targets for part in (target.instance, target.model))
        if key not in scenes:
            if len(scenes) >= CACHED_SCENES:
                del scenes[next(iter(scenes))]
            # Instances and models are kept alive so that their ids stay unique; not the frame, whose cache this is.
            scenes[key] = tuple((target.instance, target.model) for target in targets), self._make(targets)
        return scenes[key][1]

    def _make(self, targets: Sequence[Target]) -> SceneColours | None:
        grids = tuple(colour_grid(target.model) if self.off_reason(target) is None else None for target in targets)
        if all(grid is None for grid in grids):
            return None
        n_own = np.array([np.count_nonzero(own_pixels(target)) for target in targets])
        has_term = np.array([grid is not None for grid in grids])
        shares = np.where(has_term, n_own / max(int(n_own.sum()), 1), 0.0)
        observed = self._image(targets[0].observation)
        some = [np.zeros((0, 3), np.float32) if grid is None else grid.cells.reshape(-1, 3) for grid in grids]
        arrays = (
            np.concatenate(some),
            np.cumsum([0, *map(len, some)], dtype=np.int64),
            np.array([(0, 0, 0) if grid is None else grid.cells.shape[:3] for grid in grids], np.int64),
            np.array([np.zeros(3) if grid is None else grid.origin_m for grid in grids]),
            np.array([0.0 if grid is None else 1 / grid.cell_m for grid in grids]),
            observed,
        )
        return SceneColours(grids, observed, shares, self._weight * float(shares.sum()), arrays)

    def off_reason(self, target: Target) -> str | None:
        """Why the term is off for a target, in a few words; None where it is on."""
        if target.observation.rgb is None:
            return "the frame has no colour image"
        if not target.model.has_colors:
            return "its model has no colours"
        if colour_grid(target.model).contrast < LEAST_CONTRAST:
            return "its model is of one colour"
        seen = self._image(target.observation)[own_pixels(target)]
        if len(seen) == 0 or np.sqrt(seen.astype(np.float64).var(axis=0).sum()) < LEAST_CONTRAST:
            return "the image has no contrast there"
        return None

    def _image(self, observation: Observation) -> NDArray[np.float32]:
        if observation not in self._images:
            assert observation.rgb is not None
            self._images[observation] = smoothed(observation.rgb)
        return self._images[observation]


def own_pixels(target: Target) -> NDArray[np.bool_]:
    """(H, W) the pixels of a target's mask with depth."""
    return target.instance.mask & (target.observation.depth_m > 0)
