"""Finds the allowed poses: all poses whose score differs from an answer's by no more than noise explains.

Three parts, all of them batches of scores:

- Small motions. The score near the answer is fitted by a quadratic, the noise of its gradient is that of the depth
  image and of what the fit leaves unexplained. Where the score's maximum would lie without the errors then has the
  covariance H⁻¹ G H⁻¹ (the "sandwich" of M-estimators, Huber 1967).
- Far motions along an axis, as of a mug whose handle is hidden: step by step outwards, at each step by small motions
  back to the highest score, as long as it is not lower by more than its noise.
- Poses by themselves: near-symmetries of the shape, and others that are handed in, each by small motions to its highest
  score.

Answers depend on the arguments only: page, batch and report have the same bits.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.model import CONTINUOUS_STEPS
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Iteration
from verefine_viz.core.scores import PoseScore
from verefine_viz.evaluation.allowed_poses import (
    CANNOT_TELL,
    LONGEST_MM,
    AlikePose,
    AllowedPoses,
    Axis,
    Extent,
    SixMotions,
    SmallMotions,
)
from verefine_viz.evaluation.coarse_target import coarse_target
from verefine_viz.evaluation.depth_noise import ScoreNoise
from verefine_viz.evaluation.near_symmetry import flips, near_symmetries
from verefine_viz.evaluation.pose_axes import axes_of
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.evaluation.rotation_errors import symmetric_angles_rad

APART = 0.1
"""Poses closer to each other than this share of the diameter (ADD(-S)) count as one."""
SAMPLES, SPREAD_MM = 80, 3.0
"""Number of poses that the quadratic is fitted to, and their spread [mm]; turns move the surface by as much."""
FLATTEST = 0.02
"""Least curvature of the score, as a share of the largest one; lower ones are raised to it."""
FAR_DEG = (3.0, 6.0, 12.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0, 110.0, 130.0, 150.0, 165.0, 180.0)
FAR_MM = (2.0, 4.0, 8.0, 16.0, LONGEST_MM)
"""Steps outwards along an axis."""
NEAR_AXES = 0.7
"""Cosine of the angle up to which of two axes the wider one is followed alone."""
GAIN = 0.05
"""Deficit in score above which a pose is not tried, as small motions do not gain as much."""
DIP = 0.02
"""Fall in score that does not end a search along an axis, as its small motions may not have been the best."""
TRIES, ROUNDS, MORE_ROUNDS, SHORTER = 6, 2, 4, 0.6
"""Small motions that are tried at once on the way outwards; how often, and how often more where it is not clear whether
a pose is allowed; how much shorter they get each time."""
BEST_ROUNDS = 4
"""Rounds of small motions from the best pose near the answer."""
MOST_ALIKE = 6
"""Most isolated poses that are tried."""
PARALLEL = 0.97
"""Cosine of the angle up to which two axes count as one."""
SAME_DEG = 1.0
"""Angle up to which a declared symmetry must undo a turn for the object to look the same [deg]."""


def allowed_poses(
    verifier: Verifier,
    target: Target,
    T_cam_obj: Float,
    placed: Sequence[Placed] = (),
    iterations: Iterable[Iteration] = (),
    others: Sequence[Float] = (),
) -> AllowedPoses:
    """The poses that an image allows beside an answer.

    Args:
        verifier: whose score it is.
        target: the object.
        T_cam_obj: (4, 4) the answer.
        placed: other objects that may hide parts.
        iterations: of the run that answered: its poses are looked at too, beside the answer after each near-symmetry.
        others: further poses (4, 4) to look at.
    """
    turned = T_cam_obj @ flips(near_symmetries(target.model))
    return _Search(verifier, target, T_cam_obj, placed).allowed([*others, *turned, *run_poses(target, iterations)])


def alike_pose(
    verifier: Verifier, target: Target, allowed: AllowedPoses, T_cam_obj: Float, placed: Sequence[Placed] = ()
) -> AlikePose:
    """One of the allowed poses (4, 4), compared with the answer."""
    scores = verifier.score(target, np.array([allowed.T_best, T_cam_obj]), placed)
    noise = ScoreNoise(verifier, target, allowed.T_best, placed, allowed.small.six.ends())
    return AlikePose(
        T_cam_obj,
        scores[1].score,
        scores[0].score,
        noise.of(T_cam_obj, scores[1].n_pixels),
        add_s_mm(target.model, T_cam_obj, allowed.T_cam_obj),
    )


def run_poses(target: Target, iterations: Iterable[Iteration]) -> list[Float]:
    """All poses (4, 4) that a run had of an object: hypotheses, every stage of its iterations, and where a search
    placed it to complete a scene.
    """
    own, poses = target.instance.instance_id, [h.T_cam_obj for h in target.instance.hypotheses]
    for iteration in iterations:
        if iteration.instance_id == own:
            poses += [stage.T_cam_obj for stage in iteration.stages]
        elif iteration.tree is not None:
            poses += [p.T_cam_obj for p in iteration.tree.rollout if p.instance_id == own]
    return poses


@dataclass
class _Way:
    """State of a search along one axis, to one side."""

    number: int
    axis: Axis
    side: float
    T_cam_obj: Float
    offset: float = 0.0
    end: float = 0.0
    steps: tuple[tuple[float, Float], ...] = ()
    """(offset, pose) of each step that is allowed."""
    is_open: bool = True
    step: int = 0
    margin: float = 0.0
    """By how much less than noise explains the score had fallen at the last step."""


class _Search:
    """The search for the allowed poses of one answer."""

    def __init__(self, verifier: Verifier, target: Target, T_cam_obj: Float, placed: Sequence[Placed]) -> None:
        self.verifier, self.target, self.placed, self.T = verifier, target, placed, T_cam_obj
        self.coarse, self.every = coarse_target(target)
        """The object in a coarser image, of every n-th pixel."""
        self.axes = axes_of(target, T_cam_obj)
        self.rng = np.random.default_rng(0)
        centre, directions = _centre(self.axes), np.array([axis.direction_cam for axis in self.axes[:3]])
        reach = apply(T_cam_obj, target.model.points) - centre
        # Root mean square distance of the surface from an axis through the centre.
        lever_mm = 1e3 * float(np.sqrt(2 / 3 * np.mean((reach * reach).sum(axis=1))))
        unit = SPREAD_MM * np.array([1.0, 1, 1, *[np.rad2deg(1 / max(lever_mm, 1.0))] * 3])
        self.six = SixMotions(T_cam_obj, centre, directions, unit)

    def scores(self, poses: Sequence[Float]) -> list[PoseScore]:
        """Scores in the coarser image."""
        scores = self.verifier.score(self.coarse, np.array(poses), self.placed)
        return [scores[k] for k in range(len(poses))]

    def noise_of(self, T_cam_obj: Float, score: PoseScore) -> float:
        """Standard deviation of the difference of a pose's score to the highest one."""
        coarse = (self.every - 1) * self.noise.least
        return float(np.hypot(self.noise.of(T_cam_obj, score.n_pixels * self.every**2), coarse))

    def allowed(self, others: Sequence[Float]) -> AllowedPoses:
        """All allowed poses; ``others`` are isolated poses (4, 4) to try as well."""
        small = self._small_motions()
        self.spread = np.minimum(np.sqrt(np.diag(small.covariance)), 0.5 * self.six.unit)
        """(6,) size of the small motions that search for the highest score."""
        ((self.T_best, self.best),) = self._climbed([(self.T_best, None)], range(BEST_ROUNDS))
        ways = self._followed(small)
        extents = tuple(self._extent(k, axis, small, ways) for k, axis in enumerate(self.axes))
        apart, far = self._alike(others, extents), self._far(extents)
        # What is reported are scores of the whole image.
        poses = [self.T, self.T_best, *(T for T, _ in (*apart, *far))]
        score, best, *scores = self.verifier.score(self.target, np.array(poses), self.placed).score.tolist()
        alike = [
            AlikePose(T, own, best, noise, add_s_mm(self.target.model, T, self.T))
            for (T, noise), own in zip((*apart, *far), scores, strict=True)
        ]
        elsewhere = alike[: len(apart)]
        furthest = max(alike, key=lambda one: one.apart_mm, default=None)
        return AllowedPoses(
            self.T,
            score,
            self.T_best,
            small,
            extents,
            tuple(sorted(elsewhere, key=lambda one: -one.score)),
            None if any(one.is_better for one in elsewhere) else furthest,
            500 * self.target.model.diameter_m,
        )

    # Small motions.

    def _small_motions(self) -> SmallMotions:
        unit = self.six.unit
        half = self.rng.standard_normal((SAMPLES // 2, 6))
        X = np.concatenate([half, -half])
        poses = [self.T, *(self.six.moved(unit * x) for x in X)]
        scores = self.scores(poses)
        values = np.array([one.score for one in scores])
        best = int(np.argmax(values))
        self.T_best, self.best = poses[best], scores[best]
        """The pose with the highest score near the answer, which others are compared with."""
        gradient, hessian = _quadratic(X, values[1:])
        bends, turned = np.linalg.eigh(hessian)
        bends = np.maximum(bends, FLATTEST * max(float(bends[-1]), 1e-12))
        back = turned / bends @ turned.T
        # Nothing is known further out than what was sampled.
        offset = np.clip(back @ gradient, -1.0, 1.0) * unit
        likeliest = self.six.moved(offset)
        (peak,) = self.scores([likeliest])
        if peak.score > self.best.score:
            self.T_best, self.best = likeliest, peak
        self.noise = ScoreNoise(self.verifier, self.target, self.T_best, self.placed, self.six.ends())
        if self.noise.gradient is None:  # The score is not made of pixels: its fall by its noise bounds a motion.
            covariance = 2 * self.noise.most / CANNOT_TELL * back
        else:
            noise = self.noise.gradient / 2
            covariance = back @ (noise.T @ noise / len(noise)) @ back
        spread = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
        covariance *= np.outer(*[np.minimum(1.0, 1.0 / spread)] * 2) * np.outer(unit, unit)
        return SmallMotions(self.six, offset, covariance)

    # Far motions.

    def _followed(self, small: SmallMotions) -> list[_Way]:
        ways: list[_Way] = []
        widths = [max(-low, high) for low, high in map(small.within, self.axes)]
        # The widest first: others that are not far from it are uncertain because it is.
        for k in sorted(range(len(self.axes)), key=lambda k: -widths[k] / _steps(self.axes[k])[0]):
            axis = self.axes[k]
            if widths[k] < _steps(axis)[0]:
                break
            if any(way.axis.kind == axis.kind and _is_near(way.axis, axis) for way in ways):
                continue
            ways += [_Way(k, axis, side, self.T_best) for side in (-1.0, 1.0)]
        going = ways
        while going:
            self._step(going)
            going = [way for way in going if way.is_open]
        return ways

    def _step(self, ways: Sequence[_Way]) -> None:
        """Take one more step along each axis."""
        for way in ways:
            offset = way.side * _steps(way.axis)[way.step]
            way.T_cam_obj = way.axis.moved(way.T_cam_obj, offset - way.offset)
            way.offset = offset
        free = [way for way in ways if not self._is_same(way.axis, way.offset)]
        climbed = self._climbed([(way.T_cam_obj, way.axis) for way in free], range(ROUNDS))
        margins = {id(way): self._margin(*top) for way, top in zip(free, climbed, strict=True)}
        # Where it is not clear, a few more small motions.
        unclear = [k for k, way in enumerate(free) if margins[id(way)] < 0 and self._fall(climbed[k][1]) < DIP]
        more = self._climbed([(climbed[k][0], free[k].axis) for k in unclear], range(1, 1 + MORE_ROUNDS))
        for k, top in zip(unclear, more, strict=True):
            climbed[k], margins[id(free[k])] = top, self._margin(*top)
        best = dict(zip(map(id, free), climbed, strict=True))
        for way in ways:
            margin, fall = CANNOT_TELL * self.noise.least, 0.0
            if id(way) in best:
                way.T_cam_obj, score = best[id(way)]
                margin, fall = margins[id(way)], self._fall(score)
            if margin >= 0:
                way.end, way.steps = way.offset, (*way.steps, (way.offset, way.T_cam_obj))
            elif way.end == (way.side * _steps(way.axis)[way.step - 1] if way.step else 0.0):
                inner = way.margin if way.step else max(CANNOT_TELL * self.noise.least, 1e-9)
                way.end += (way.offset - way.end) * inner / (inner - margin)
            way.margin = margin
            way.step += 1
            way.is_open = way.step < len(_steps(way.axis)) and (margin >= 0 or fall < DIP)

    def _fall(self, score: PoseScore) -> float:
        return self.best.score - score.score

    def _margin(self, T_cam_obj: Float, score: PoseScore) -> float:
        """By how much less than noise explains a pose's score is below the highest."""
        fall = self._fall(score)
        if fall <= 0 or fall > CANNOT_TELL * self.noise.most:  # Its own noise does not matter.
            return CANNOT_TELL * self.noise.most - fall
        return CANNOT_TELL * self.noise_of(T_cam_obj, score) - fall

    def _climbed(self, starts: Sequence[tuple[Float, Axis | None]], rounds: range) -> list[tuple[Float, PoseScore]]:
        """The highest scores that small motions lead to from each pose, none of them along its axis."""
        poses, scores = [T for T, _ in starts], self.scores([T for T, _ in starts]) if starts else []
        for round_ in rounds:
            tried: list[Float] = []
            for T, (_, axis) in zip(poses, starts, strict=True):
                tried += self._motions(T, axis, SHORTER**round_)
            tried_scores = self.scores(tried) if tried else []
            for k in range(len(starts)):
                own = range(k * TRIES, (k + 1) * TRIES)
                best = max(own, key=lambda i: tried_scores[i].score)
                if tried_scores[best].score > scores[k].score:
                    poses[k], scores[k] = tried[best], tried_scores[best]
        return list(zip(poses, scores, strict=True))

    def _motions(self, T_cam_obj: Float, axis: Axis | None, size: float) -> list[Float]:
        """Random small motions of a pose, none of them along its axis."""
        motions = size * self.spread * self.rng.standard_normal((TRIES, 6))
        if axis is not None:
            along = self.six.along(axis)
            motions -= np.outer(motions @ along, along)
        (centre,) = apply(T_cam_obj @ inverse(self.T), self.six.centre_cam[None])
        about = replace(self.six, T_cam_obj=T_cam_obj, centre_cam=centre)
        return [about.moved(motion) for motion in motions]

    def _is_same(self, axis: Axis, offset: float) -> bool:
        """Whether a declared symmetry undoes the turn, so that only the facets of the mesh would differ."""
        model = self.target.model
        if not model.is_symmetric or axis.kind == "shift":
            return False
        # Continuous ones are listed in steps: where the turn by the nearest of these looks the same, so does this one.
        step_deg = 360 / CONTINUOUS_STEPS
        listed_deg = np.copysign(max(1, round(abs(offset) / step_deg)) * step_deg, offset)
        rest_rad = symmetric_angles_rad(model, axis.moved(self.T, listed_deg), self.T).min()
        return bool(np.rad2deg(rest_rad) < SAME_DEG)

    def _extent(self, number: int, axis: Axis, small: SmallMotions, ways: Sequence[_Way]) -> Extent:
        low, high = small.within(axis)
        own = [way for way in ways if way.axis.kind == axis.kind and _is_parallel(way.axis, axis)]
        steps: dict[float, Float] = {}
        for way in own:
            sense = float(np.sign(way.axis.direction_cam @ axis.direction_cam))
            end = sense * way.end
            low, high = min(low, end), max(high, end)
            if way.number == number and len(way.steps) > 1:
                steps |= dict(way.steps)
        offsets = sorted({**steps, 0.0: self.T_best}) if steps else []
        poses = [self.T_best if x == 0 else steps[x] for x in offsets]
        return Extent(axis, low, high, np.array(offsets), np.array(poses).reshape(-1, 4, 4))

    # Poses by themselves.

    def _alike(self, others: Sequence[Float], extents: Sequence[Extent]) -> list[tuple[Float, float]]:
        """The other poses that fit as well, or better, and the noise of the difference."""
        least_mm, model = 1e3 * APART * self.target.model.diameter_m, self.target.model
        apart = [T for T in others if add_s_mm(model, T, self.T) > least_mm]
        if not apart:
            return []
        scores = self.scores(apart)
        known, chosen = [T for extent in extents for T in extent.along()], list[Float]()
        for k in sorted(range(len(apart)), key=lambda k: -scores[k].score):
            if len(chosen) == MOST_ALIKE or scores[k].score < self.best.score - GAIN:
                break
            if all(add_s_mm(model, apart[k], T) > least_mm for T in (*known, *chosen)):
                chosen.append(apart[k])
        climbed = self._climbed([(T, None) for T in chosen], range(ROUNDS))
        near = [(T, None) for T, score in climbed if self._fall(score) < DIP]
        alike: list[tuple[Float, float]] = []
        for T, score in self._climbed(near, range(1, 1 + MORE_ROUNDS)):
            noise = self.noise_of(T, score)
            if self._fall(score) <= CANNOT_TELL * noise and add_s_mm(model, T, self.T) > least_mm:
                alike.append((T, noise))
        return alike

    def _far(self, extents: Sequence[Extent]) -> list[tuple[Float, float]]:
        """The pose along an axis that is furthest away, and its noise; none where it is near."""
        model = self.target.model
        poses = [T for extent in extents for T in extent.poses]
        far = max(poses, key=lambda T: add_s_mm(model, T, self.T), default=None)
        if far is None or add_s_mm(model, far, self.T) <= 1e3 * APART * model.diameter_m:
            return []
        (score,) = self.scores([far])
        return [(far, self.noise_of(far, score))]


def _quadratic(X: Float, values: Float) -> tuple[Float, Float]:
    """Gradient (n,) and minus the Hessian (n, n) at 0 of the quadratic next to values (m,) at points (m, n)."""
    n = X.shape[1]
    i, j = np.triu_indices(n)
    terms = np.concatenate([np.ones((len(X), 1)), X, -X[:, i] * X[:, j] * np.where(i == j, 0.5, 1.0)], axis=1)
    fitted = np.linalg.lstsq(terms, values, rcond=None)[0]
    hessian = np.zeros((n, n))
    hessian[i, j] = hessian[j, i] = fitted[n + 1 :]
    return np.asarray(fitted[1 : n + 1], np.float64), hessian


def _centre(axes: Sequence[Axis]) -> Float:
    """(3,) the point that is nearest to the table's three axes of turns [m]."""
    A, b = np.zeros((3, 3)), np.zeros(3)
    for axis in axes[3:6]:
        across = np.eye(3) - np.outer(axis.direction_cam, axis.direction_cam)
        A, b = A + across, b + across @ axis.pivot_cam
    return np.asarray(np.linalg.solve(A, b), np.float64)


def _steps(axis: Axis) -> tuple[float, ...]:
    """Offsets at which an axis is followed [mm] or [deg]."""
    return FAR_MM if axis.kind == "shift" else FAR_DEG


def _is_near(one: Axis, other: Axis) -> bool:
    return abs(float(one.direction_cam @ other.direction_cam)) > NEAR_AXES


def _is_parallel(one: Axis, other: Axis) -> bool:
    return abs(float(one.direction_cam @ other.direction_cam)) > PARALLEL
