"""Whether depth, masks, models and poses of a frame belong together; where they do not, what would fit, by trying it.

An object is drawn at its ground-truth pose, or at its first initial pose, and compared with what was measured: the
share of the pixels of mask and drawing together where both are, at about the same depth. Where that is small, each
common mistake is undone in turn (another unit, another convention, an inverted mask) and drawn again. A doubt names the
one that makes the share large; where none does, it says only what does not fit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from verefine_viz.calibration.camera_check import camera_notes
from verefine_viz.core.arrays import Float, Mask, writable
from verefine_viz.core.geometry import axis_angle, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Problem
from verefine_viz.core.text_format import listed
from verefine_viz.rendering.mesh import RenderMesh, render_mesh
from verefine_viz.rendering.rasterizer import draw_depth

TRUTH = "ground truth"
MOST_SOURCES = 4
"""Sources of initial poses that are looked at."""
MOST, ROWS = 5, 160
"""Objects that are looked at, those with the largest masks, and rows of the image in which they are drawn."""
FITS, FITS_INITIAL, OFF = 0.5, 0.35, 0.2
"""Share of the pixels from which an explanation is believed, at a ground-truth and at an initial pose; and below which
a pose is off even without one."""
SUSPECT = 0.6
"""Below it explanations are tried for a ground-truth pose: symmetric shapes fit in part whatever is wrong."""
BETTER = 0.3
"""So much more must fit with an explanation than without."""
NEAR_M, NEAR, NEAR_INITIAL = 0.015, 0.06, 0.3
"""Depth this near to a model is its own: at least [m], as a share of its diameter, and the same at an initial pose,
which may be off."""
FEWEST_PX = 12
"""A mask with fewer pixels, of the smaller image, shows nothing."""
UNITS = (10.0, 0.1, 1000.0, 0.001, 100.0, 0.01, 25.4, 1 / 25.4)
"""Factors between units that are mixed up: mm, cm, m and inches."""
TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
UNEXPLAINED = "no other unit or convention would fit"
CURVED, CURVED_M, ASIDE = 0.4, 0.004, 1.03
"""Distances instead of depth: so much smaller must the error be with them, so large without them [m], and so much
longer the objects' rays than z; an offset of the sensor looks the same near the image's centre."""
STEPS, FEWEST_STEPS, STEP_M = 255, 12, 1e-3
"""Depth of 8 bits: so many steps at most, so many that differ at least, each at least so large [m]."""


@dataclass(frozen=True, eq=False)
class Seen:
    """An object in a frame, in a smaller image."""

    name: str
    model: ObjectModel
    T_cam_obj: Float
    """(4, 4), where it should be."""
    source: str
    """What says so: "ground truth", or an estimator."""
    mask: Mask
    """(h, w)."""
    depth_m: NDArray[np.float32]
    """(h, w), 0 = nothing was measured."""
    rays: Float
    """(h, w) length of the ray of each pixel that reaches z = 1."""
    K: Float
    """(3, 3) of the smaller image."""
    model_times: float = 1.0
    """Its model counts as so many times as large."""

    @property
    def is_truth(self) -> bool:
        """Whether its pose is the true one, not an estimate."""
        return self.source == TRUTH

    @property
    def near_m(self) -> float:
        """Depth is the model's where it is nearer to it than this."""
        share = NEAR if self.is_truth else NEAR_INITIAL
        return max(NEAR_M, share * self.model.diameter_m * self.model_times)

    def drawn_m(self) -> NDArray[np.float32]:
        """The depth (h, w) of the model in its pose, 0 beside it."""
        out = np.zeros(self.mask.shape, np.float32)
        mesh = _mesh(self.model, self.model_times)
        fx, fy, cx, cy = (float(self.K[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
        draw_depth(writable(self.T_cam_obj), *mesh.arrays, fx, fy, cx, cy, out)
        return out

    def fit(self) -> float:
        """The share of the pixels of mask and drawing where both are, and depth is the model's."""
        drawn_m = self.drawn_m()
        drawn, measured = drawn_m > 0, self.depth_m > 0
        hidden = drawn & ~self.mask & measured & (self.depth_m < drawn_m - self.near_m)
        either = (self.mask | drawn) & ~hidden & (measured | (drawn != self.mask))
        both = self.mask & drawn & measured & (np.abs(drawn_m - self.depth_m) < self.near_m)
        return float(np.count_nonzero(both)) / max(int(np.count_nonzero(either)), 1)

    def error_m(self) -> float:
        """The median distance of measured from drawn depth [m] where both are; infinite where they nowhere are."""
        drawn_m = self.drawn_m()
        both = self.mask & (drawn_m > 0) & (self.depth_m > 0)
        return float(np.median(np.abs(drawn_m - self.depth_m)[both])) if both.any() else np.inf


@dataclass(frozen=True)
class Explanation:
    """A common mistake."""

    words: str
    """What would fit, and what to look at."""
    undo: Callable[[Seen], Seen]
    only_truth: bool = False
    """Whether an initial pose, which may be off by tens of degrees, cannot show it."""


def _times(factor: float) -> str:
    return f"{factor:g} times as large" if factor >= 1 else f"{1 / factor:g} times smaller"


def _units() -> Iterator[Explanation]:
    for f in UNITS:
        yield Explanation(
            f"depth that is {_times(f)} would fit: check the unit of the depth images (depth_scale)",
            lambda s, f=f: replace(s, depth_m=s.depth_m * np.float32(f)),
        )
    for f in UNITS:
        yield Explanation(
            f"models that are {_times(f)} would fit: check the unit of the meshes",
            lambda s, f=f: replace(s, model_times=f),
        )
    for f in UNITS:
        yield Explanation(
            f"translations that are {_times(f)} would fit: check the unit of the poses",
            lambda s, f=f: replace(s, T_cam_obj=transform(s.T_cam_obj[:3, :3], f * s.T_cam_obj[:3, 3])),
        )


def _conventions() -> Iterator[Explanation]:
    yield Explanation(
        "the inverse poses would fit: these look like poses of the camera in the object's frame",
        lambda s: replace(s, T_cam_obj=inverse(s.T_cam_obj)),
    )
    yield Explanation(
        "poses in OpenGL's camera axes (y up, z backwards) would fit: turn them by diag(1, −1, −1)",
        lambda s: replace(s, T_cam_obj=TO_OPENGL @ s.T_cam_obj),
    )
    yield Explanation(
        "inverted masks would fit: the mask covers everything but the object",
        lambda s: replace(s, mask=~s.mask),
    )
    yield Explanation(
        "transposed rotations would fit: the matrices look as if they were written column by column",
        lambda s: replace(s, T_cam_obj=transform(s.T_cam_obj[:3, :3].T, s.T_cam_obj[:3, 3])),
        only_truth=True,
    )
    for axis, deg in (("x", 90), ("x", -90)):
        turn = transform(axis_angle(np.array([1.0, 0.0, 0.0]), np.radians(deg)), np.zeros(3))
        yield Explanation(
            f"models turned by {deg}° about {axis} would fit: the meshes look as if another axis were up",
            lambda s, turn=turn: replace(s, T_cam_obj=s.T_cam_obj @ turn),
            only_truth=True,
        )


EXPLANATIONS = (*_units(), *_conventions())


def data_doubts(problem: Problem) -> tuple[str, ...]:
    """Return what of a frame does not fit together: units and conventions, else the camera by the ground truth."""
    explained, unexplained = _doubts(problem)
    return (*coarse_depth(problem), *(explained or camera_notes(problem) or unexplained))


def doubts(problem: Problem) -> tuple[str, ...]:
    """Return which units and conventions of a frame do not fit together, without a look at the camera."""
    explained, unexplained = _doubts(problem)
    return (*coarse_depth(problem), *(explained or unexplained))


def _doubts(problem: Problem) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what does not fit and what would, and what does not fit whatever is tried.

    By ground truth; where that fits, or is unknown, by the initial poses of each source.
    """
    truths = {i.instance_id: i.T_cam_obj_gt for i in problem.instances if i.T_cam_obj_gt is not None}
    explained, unexplained = _pose_doubts(problem, truths, TRUTH)
    if explained or unexplained:
        return explained, unexplained
    by_source: dict[str, dict[int, Float]] = {}
    for instance in problem.instances:
        for one in instance.hypotheses:
            if not one.source.startswith("perturbed"):  # Those are made from the ground truth.
                by_source.setdefault(one.source.partition(" #")[0], {}).setdefault(instance.instance_id, one.T_cam_obj)
    sources = [*by_source.items()][:MOST_SOURCES]
    return tuple(doubt for name, poses in sources for doubt in _pose_doubts(problem, poses, name)[0]), ()


def _pose_doubts(problem: Problem, poses: Mapping[int, Float], source: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    named: dict[str, list[Seen]] = {}
    off: list[Seen] = []
    objects = seen_objects(problem, poses, source)
    for one in objects:
        fit = one.fit()
        if fit < (SUSPECT if one.is_truth else OFF):
            words = explanation(one, fit, objects)
            if words:
                named.setdefault(words, []).append(one)
            elif fit < OFF:
                off.append(one)
    explained = tuple(f"{_what(of)}; {words}" for words, of in named.items()) or tuple(distances_for_depth(objects))
    if not off or not off[0].is_truth:
        return explained, ()
    # A single pose or mask may be wrong for reasons of its own; all of them are not.
    check = "check camera, depth, masks and poses" if len(off) == len(objects) else "check its mask and its pose"
    return explained, (f"{_what(off)}; {UNEXPLAINED}: {check}",)


def explanation(one: Seen, fit: float, objects: Sequence[Seen]) -> str:
    """Return in words what would fit an object; "" where nothing does. ``objects``: all that are looked at."""
    least = max(FITS if one.is_truth else FITS_INITIAL, fit + BETTER)
    best, k = max(((undone.fit(), -k) for k, undone in _undone(one)), default=(0.0, 0))
    if best >= least:
        return EXPLANATIONS[-k].words
    if one.is_truth:  # Estimates are given to the masks that they fit.
        for other in objects:
            if other is not one and replace(one, mask=other.mask).fit() >= least:
                return f"the mask of {other.name} would fit: masks and poses look as if they were in another order"
    return ""


def _undone(one: Seen) -> Iterator[tuple[int, Seen]]:
    for k, mistake in enumerate(EXPLANATIONS):
        if one.is_truth or not mistake.only_truth:
            undone = mistake.undo(one)
            if undone.T_cam_obj[2, 3] > 0.02:
                yield k, undone


def distances_for_depth(objects: Sequence[Seen]) -> Iterator[str]:
    """Return a doubt where the depth images hold distances from the camera, not z."""
    truths = [one for one in objects if one.is_truth and np.median(one.rays[one.mask]) > ASIDE]
    if truths:
        as_z = [one.error_m() for one in truths]
        as_distance = [replace(one, depth_m=(one.depth_m / one.rays).astype(np.float32)).error_m() for one in truths]
        if np.median(as_z) > CURVED_M and np.median(as_distance) < CURVED * np.median(as_z):
            yield (
                f"depth is off by {1e3 * np.median(as_z):.0f} mm from the ground-truth poses, and by "
                f"{1e3 * np.median(as_distance):.0f} mm if it is the distance from the camera: the depth images "
                "seem to hold distances, expected z"
            )


def coarse_depth(problem: Problem) -> tuple[str, ...]:
    """Return a doubt where depth is a multiple of a large step everywhere, as 8 bits hold it."""
    values_m = np.unique(problem.observation.depth_m).astype(np.float64)
    values_m = values_m[values_m > 0]
    if not FEWEST_STEPS <= len(values_m) <= STEPS:
        return ()
    steps_m = values_m[-1] / np.arange(1, STEPS + 1)
    in_steps = values_m / steps_m[:, None]
    fits = (np.abs(in_steps - np.round(in_steps)).max(axis=1) < 0.1) & (steps_m > 0.9 * STEP_M)
    if not fits.any():
        return ()
    step_m = steps_m[fits][0]
    return (
        f"depth has {len(values_m)} different values only, {1e3 * step_m:.3g} mm apart: it looks as if it was stored "
        "in 8 bits, store it in 16",
    )


def _what(objects: Sequence[Seen]) -> str:
    names, (them, plural) = listed([one.name for one in objects]), ("it", "") if len(objects) == 1 else ("them", "s")
    poses = f"ground-truth pose{plural}" if objects[0].is_truth else f"pose{plural} of {objects[0].source}"
    return f"what is seen of {names} is not where the {poses} put{'' if plural else 's'} {them}"


def seen_objects(problem: Problem, poses: Mapping[int, Float], source: str) -> list[Seen]:
    """Return the objects of a frame with these T_cam_obj (4, 4), by instance_id, those with the largest masks."""
    observation = problem.observation
    step = max(1, observation.camera.height // ROWS)
    depth_m = np.ascontiguousarray(observation.depth_m[::step, ::step], np.float32)
    K = observation.camera.K.copy()
    K[:2] /= step
    v, u = np.indices(depth_m.shape)
    rays = np.sqrt(1 + ((u - K[0, 2]) / K[0, 0]) ** 2 + ((v - K[1, 2]) / K[1, 1]) ** 2)
    largest = sorted(problem.instances, key=lambda i: -int(np.count_nonzero(i.mask)))
    seen = []
    for instance in largest[:MOST]:
        T, mask = poses.get(instance.instance_id), np.ascontiguousarray(instance.mask[::step, ::step])
        if T is not None and np.count_nonzero(mask & (depth_m > 0)) >= FEWEST_PX:
            model = problem.models[instance.obj_id]
            seen.append(Seen(model.name, model, T, source, mask, depth_m, rays, K))
    return seen


@lru_cache(maxsize=64)
def _mesh(model: ObjectModel, times: float) -> RenderMesh:
    return render_mesh(times * model.vertices, model.faces)
