"""The score around a pose: how it falls as the object is shifted and turned, and how far the observation cannot tell.

From a pose the object is shifted along and turned about the axes of the table and of the model. A shift or turn is
undetermined as far as the score falls by less than the noise of the score (:mod:`verefine_viz.evaluation.depth_noise`)
explains. Answers depend on the arguments only: page, batch and report have the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.scores import Scores
from verefine_viz.evaluation.depth_noise import ScoreNoise
from verefine_viz.evaluation.pose_errors import symmetric_angles_rad
from verefine_viz.scenes.models import CONTINUOUS_STEPS

Kind = Literal["shift", "turn"]
Frame = Literal["table", "object"]
Letter = Literal["x", "y", "z"]
LETTERS: tuple[Letter, ...] = ("x", "y", "z")

SHIFTS_MM = (1.0, 2.0, 4.0, 8.0, 16.0, 30.0)
TURNS_DEG = (1.5, 3.0, 6.0, 12.0, 25.0, 45.0, 70.0, 90.0, 115.0, 135.0, 160.0, 180.0)
"""Distances from the pose, to both sides, at which it is scored."""
CANNOT_TELL = 2.0
"""A difference of less than so many standard deviations of its noise is none."""
AXIS_WORDS = (
    "shift right", "shift away", "shift up", "tilt to the camera", "tilt sideways", "turn about the vertical",
    "shift along its x", "shift along its y", "shift along its z",
    "turn about its x", "turn about its y", "turn about its z",
)  # fmt: skip
"""Three shifts and three turns of the table, then of the model; "right" and "away" are the camera's."""
N_AXES = len(AXIS_WORDS)
SAME_DEG = 1.0
"""A turn that a declared symmetry undoes but for less than this looks the same [deg]."""
SLICE = 13
"""Poses along a side of a 2D slice."""
ROBUST_M = 0.002
"""A point that a turn moves off its surface by more than this counts less for where the turn's axis is [m]."""


@dataclass(frozen=True, eq=False)
class Axis:
    """One way to move the object: along a direction, or about it."""

    kind: Kind
    frame: Frame
    letter: Letter
    direction_cam: Float
    """(3,) unit."""
    pivot_cam: Float
    """(3,) a point on the axis of a turn [m]."""
    words: str
    """What moves: "turn about the vertical"."""

    @property
    def unit(self) -> str:
        return "mm" if self.kind == "shift" else "°"

    @property
    def steps(self) -> tuple[float, ...]:
        """Distances at which it is scored [mm] or [deg]."""
        return SHIFTS_MM if self.kind == "shift" else TURNS_DEG

    def moved(self, T_cam_obj: Float, offset: float) -> Float:
        """The pose (4, 4) shifted by ``offset`` [mm] or turned by it [deg]."""
        if self.kind == "shift":
            return transform(T_cam_obj[:3, :3], T_cam_obj[:3, 3] + 1e-3 * offset * self.direction_cam)
        R = axis_angle(self.direction_cam, np.deg2rad(offset))
        return transform(R @ T_cam_obj[:3, :3], R @ (T_cam_obj[:3, 3] - self.pivot_cam) + self.pivot_cam)


@dataclass(frozen=True, eq=False)
class Curve:
    """The score along one axis."""

    axis: Axis
    offsets: Float
    """(n,) ascending, 0 among them [mm] or [deg]."""
    scores: Float
    """(n,)."""
    noise: Float
    """(n,) standard deviation of the difference to the score at 0; its upper bound where the score falls by more."""
    low: float
    high: float
    """From ``low`` ≤ 0 to ``high`` ≥ 0 the observation cannot tell [mm] or [deg]."""

    @property
    def width(self) -> float:
        """The further end of what is undetermined [mm] or [deg]."""
        return max(-self.low, self.high)

    def describe(self) -> str:
        """What is undetermined: "turn about the vertical undetermined within ±25°"."""
        at_end = " or more" if self.axis.kind == "shift" and self.width >= SHIFTS_MM[-1] else ""
        return f"{self.axis.words} undetermined within {self.width_text}{at_end}"

    @property
    def width_text(self) -> str:
        """The width: "±25°" or "±0.3 mm"."""
        digits = 0 if self.width >= 10 else 1 if self.width >= 1 else 2
        return f"±{self.width:.{digits}f}{'°' if self.axis.kind == 'turn' else ' mm'}"


@dataclass(frozen=True, eq=False)
class Landscape:
    """The score around a pose, along twelve axes: shifts and turns, of the table and of the model."""

    T_cam_obj: Float
    score: float
    curves: tuple[Curve, ...]
    radius_mm: float
    """Half of the model's diameter: what a turn by 1 rad moves a far point by."""

    @property
    def axes(self) -> tuple[Axis, ...]:
        return tuple(curve.axis for curve in self.curves)

    @property
    def undetermined_mm(self) -> float:
        """The furthest shift that the score cannot tell [mm]."""
        return max(curve.width for curve in self.curves if curve.axis.kind == "shift")

    @property
    def undetermined_deg(self) -> float:
        """The furthest turn that the score cannot tell [deg]; 180 about an axis of symmetry."""
        return max(curve.width for curve in self.curves if curve.axis.kind == "turn")

    @cached_property
    def least_certain(self) -> Curve:
        """Along which the object's surface could be furthest from where it is said to be."""

        def reach_mm(curve: Curve) -> float:
            return curve.width if curve.axis.kind == "shift" else np.deg2rad(curve.width) * self.radius_mm

        widest = max(map(reach_mm, self.curves))
        # The table's axes come first: an upright can's axis is the vertical as well.
        return next(curve for curve in self.curves if reach_mm(curve) >= 0.9 * widest)

    def of(self, frame: Frame) -> tuple[Curve, ...]:
        """The six curves of one frame's axes: three shifts, three turns."""
        return tuple(curve for curve in self.curves if curve.axis.frame == frame)


@dataclass(frozen=True, eq=False)
class Slice:
    """The score over two axes at once."""

    across: Axis
    up: Axis
    across_offsets: Float
    """(n,) [mm] or [deg]."""
    up_offsets: Float
    """(n,)."""
    scores: Float
    """(n, n): a row for each offset of ``up``."""

    def pose(self, T_cam_obj: Float, column: int, row: int) -> Float:
        """The pose of one of its points."""
        return self.up.moved(self.across.moved(T_cam_obj, self.across_offsets[column]), self.up_offsets[row])


def landscape(verifier: Verifier, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = ()) -> Landscape:
    """The whole landscape of a pose (4, 4): its walk (:func:`undetermined`), and all other scores in one batch."""
    walk = _Walk(verifier, target, T_cam_obj, placed)
    walk.score_rest()
    return walk.landscape()


def undetermined(verifier: Verifier, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = ()) -> Landscape:
    """The landscape as far as it takes to know the widths: curves end where the score tells. For batches."""
    return _Walk(verifier, target, T_cam_obj, placed).landscape()


def score_slice(
    verifier: Verifier, target: Target, around: Landscape, across: int, up: int, placed: Sequence[Placed] = ()
) -> Slice:
    """The score over two of the axes of a landscape, named by their numbers, in one batch.

    It reaches twice as far as what is undetermined, and at least 10 mm or 20°.
    """
    curves = around.curves[across], around.curves[up]
    axes = curves[0].axis, curves[1].axis
    columns, rows = (np.linspace(-1, 1, SLICE) * _extent(curve) for curve in curves)
    Ts = [axes[1].moved(axes[0].moved(around.T_cam_obj, a), b) for b in rows for a in columns]
    scores = verifier.score(target, np.array(Ts), placed).score.reshape(SLICE, SLICE)
    return Slice(*axes, columns, rows, scores)


def _extent(curve: Curve) -> float:
    least, most = (10.0, SHIFTS_MM[-1]) if curve.axis.kind == "shift" else (20.0, 180.0)
    return float(np.clip(2 * curve.width, least, most))


def axes_of(target: Target, T_cam_obj: Float) -> tuple[Axis, ...]:
    """The twelve axes of a pose: shifts and turns of the table (of the camera where no table is known), then of the
    model.
    """
    support, words = target.observation.support, AXIS_WORDS
    if support is not None:
        up = support.T_world_cam[:3, :3].T @ support.normal_world
        # A camera on its side has its x axis along the vertical.
        aside = np.array([1.0, 0, 0] if abs(up[0]) < 0.9 else [0, 1.0, 0])
        right = aside - (aside @ up) * up
        right /= np.linalg.norm(right)
    else:
        up, right = np.array([0.0, -1, 0]), np.array([1.0, 0, 0])
        words = tuple(name.replace("the vertical", "the camera's vertical") for name in words)
    directions = right, np.cross(up, right), up, *T_cam_obj[:3, :3].T
    surface = _seen_surface(target, T_cam_obj)
    middle = apply(T_cam_obj, target.model.middle_m[None])[0]
    axes: list[Axis] = []
    for k, name in enumerate(words):
        frame: Frame = "table" if k < N_AXES // 2 else "object"
        is_turn = k % 6 >= 3
        direction = directions[k % 3 + (3 if frame == "object" else 0)]
        pivot = _pivot(surface, middle, direction) if is_turn else T_cam_obj[:3, 3]
        axes.append(Axis("turn" if is_turn else "shift", frame, LETTERS[k % 3], direction, pivot, name))
    return tuple(axes)


def _seen_surface(target: Target, T_cam_obj: Float) -> tuple[Float, Float]:
    """Points and normals of the model that face the camera (n, 3) each, camera frame [m]."""
    points, normals = apply(T_cam_obj, target.model.points), target.model.point_normals @ T_cam_obj[:3, :3].T
    faces = np.einsum("ij,ij->i", points, normals) < 0
    return (points[faces], normals[faces]) if faces.any() else (points, normals)


def _pivot(surface: tuple[Float, Float], middle: Float, axis: Float) -> Float:
    """The point through which a turn about ``axis`` moves the seen surface least off itself: a mug's turn is about the
    axis of its body, wherever its handle puts the middle of the model.
    """
    points, normals = surface
    x = points - middle
    # A turn moves x off its surface by n · (axis × (x − c)) = n · (axis × x) − c · (n × axis).
    off, lever = np.einsum("ij,ij->i", normals, np.cross(axis, x)), np.cross(normals, axis)
    weight, c = np.ones(len(points)), np.zeros(3)
    for _ in range(8):
        A = (lever * weight[:, None]).T @ lever
        # A little pull towards the middle, and the place along the axis does not matter.
        A += len(points) * (0.001 * np.eye(3) + np.outer(axis, axis))
        c = np.linalg.solve(A, lever.T @ (weight * off))
        weight = 1.0 / (1.0 + ((off - lever @ c) / ROBUST_M) ** 2)
    return middle + c


class _Walk:
    """Steps outwards along all axes, to both sides at once, as long as the score cannot tell."""

    def __init__(self, verifier: Verifier, target: Target, T_cam_obj: Float, placed: Sequence[Placed]) -> None:
        self._verifier, self._target, self._T, self._placed = verifier, target, T_cam_obj, placed
        self._axes = axes_of(target, T_cam_obj)
        self._noise = ScoreNoise(verifier, target, T_cam_obj, placed)
        self._score = self._noise.score
        self._samples: dict[tuple[int, float], tuple[float, float]] = {}
        """(axis, offset) → score, noise."""
        self._ends: dict[tuple[int, float], float] = {}
        """(axis, side) → how far is undetermined."""
        going = [(k, side) for k in range(len(self._axes)) for side in (-1.0, 1.0)]
        step = 0
        while going:
            going = self._stepped(going, step)
            step += 1

    def _stepped(self, going: list[tuple[int, float]], step: int) -> list[tuple[int, float]]:
        """Takes one more step on each; the same without those that have come to their end."""
        offsets = [(k, side * self._axes[k].steps[step]) for k, side in going]
        # Declared to look the same: what would differ is how the mesh's facets lie.
        same = [one for one in offsets if self._is_same(*one)]
        self._samples |= dict.fromkeys(same, (self._score, self._noise.least))
        self._score_near([one for one in offsets if one not in same])
        on: list[tuple[int, float]] = []
        for (k, side), (_, offset) in zip(going, offsets, strict=True):
            fall, noise = self._fall_and_noise(k, offset)
            if fall > CANNOT_TELL * noise:
                self._ends[k, side] = self._crossing(k, side, step)
            elif step + 1 < len(self._axes[k].steps):
                on.append((k, side))
            else:
                self._ends[k, side] = self._axes[k].steps[step]
        return on

    def _score_near(self, offsets: Sequence[tuple[int, float]]) -> None:
        """Scores poses, with their own noise where the fall of the score leaves it in doubt."""
        if not offsets:
            return
        scores = self._scored(offsets)
        for (k, offset), score, n_pixels in zip(offsets, scores.score.tolist(), scores.n_pixels.tolist(), strict=True):
            noise = self._noise.most
            if self._score - score <= CANNOT_TELL * noise:
                noise = self._noise.of(self._axes[k].moved(self._T, offset), n_pixels)
            self._samples[k, offset] = (score, noise)

    def _is_same(self, k: int, offset: float) -> bool:
        """Whether a declared symmetry undoes the turn."""
        model, axis = self._target.model, self._axes[k]
        if not model.is_symmetric or axis.kind == "shift":
            return False
        # Continuous ones are listed in steps: where the turn by the nearest of these looks the same, so does this one.
        step_deg = 360 / CONTINUOUS_STEPS
        listed_deg = np.copysign(max(1, round(abs(offset) / step_deg)) * step_deg, offset)
        rest_rad = symmetric_angles_rad(model, axis.moved(self._T, listed_deg), self._T).min()
        return bool(np.rad2deg(rest_rad) < SAME_DEG)

    def _scored(self, offsets: Sequence[tuple[int, float]]) -> Scores:
        Ts = np.array([self._axes[k].moved(self._T, offset) for k, offset in offsets])
        return self._verifier.score(self._target, Ts, self._placed)

    def _crossing(self, k: int, side: float, step: int) -> float:
        """Where the fall of the score reaches its noise, before the last step."""
        outer = self._axes[k].steps[step]
        fall, noise = self._fall_and_noise(k, side * outer)
        if step == 0:
            # Near the pose the fall grows with the square of the distance, its noise with the distance.
            return outer * CANNOT_TELL * noise / fall
        inner = self._axes[k].steps[step - 1]
        above = fall - CANNOT_TELL * noise
        inner_fall, inner_noise = self._fall_and_noise(k, side * inner)
        below = CANNOT_TELL * inner_noise - inner_fall
        return inner + (outer - inner) * below / (below + above)

    def _fall_and_noise(self, k: int, offset: float) -> tuple[float, float]:
        score, noise = self._samples[k, offset]
        return self._score - score, noise

    def score_rest(self) -> None:
        """Scores what the walk left, for whole curves."""
        every = [(k, s * o) for k, axis in enumerate(self._axes) for o in axis.steps for s in (-1.0, 1.0)]
        rest = [one for one in every if one not in self._samples]
        if rest:
            for one, score in zip(rest, self._scored(rest).score.tolist(), strict=True):
                self._samples[one] = (score, self._noise.most)

    def landscape(self) -> Landscape:
        """What is known by now."""
        curves: list[Curve] = []
        for k, axis in enumerate(self._axes):
            own = {offset: both for (of, offset), both in self._samples.items() if of == k} | {0.0: (self._score, 0.0)}
            offsets = sorted(own)
            scores, noise = np.array([own[offset] for offset in offsets]).T
            curves.append(Curve(axis, np.array(offsets), scores, noise, -self._ends[k, -1.0], self._ends[k, 1.0]))
        return Landscape(self._T, self._score, tuple(curves), 500 * self._target.model.diameter_m)
