"""Two poses that the observation cannot tell apart: the highest scores next to them differ by less than the noise of
the score, and they are further apart than 10 % of the diameter. Objects whose symmetry is not declared belong here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Iteration
from verefine_viz.diagnosis.case import Case
from verefine_viz.diagnosis.causes import Cause, Finding, distinct_texts
from verefine_viz.diagnosis.score_causes import discarded, poses_at_gt
from verefine_viz.evaluation.depth_noise import ScoreNoise
from verefine_viz.evaluation.landscape import CANNOT_TELL, Curve, Landscape, undetermined
from verefine_viz.evaluation.near_symmetry import flips, near_symmetries
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.evaluation.score_ascent import highest_near

APART = 0.1
"""Poses closer to each other than this share of the diameter (ADD(-S)) count as one."""
MORE = 20
"""Offsets between the ends of what is undetermined along an axis that are looked at as well."""
MOST_POSES = 4
"""Poses from which the highest score is sought, the best by score that are not one."""
GAIN = 0.05
"""A pose that scores less than the answer by more than this is not looked at: small motions do not gain as much."""


@dataclass(frozen=True, eq=False)
class OtherPose:
    """A pose that the observation cannot tell from an answer; scores are the highest next to both."""

    T_cam_obj: Float
    """(4, 4)."""
    score: float
    score_of_answer: float
    noise: float
    """Standard deviation of the difference of the two scores."""
    apart_mm: float
    """ADD(-S) between the two poses [mm]."""


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


def other_pose(
    verifier: Verifier,
    target: Target,
    around: Landscape,
    poses: Sequence[Float],
    placed: Sequence[Placed] = (),
    is_wanted: Callable[[Float], bool] = lambda T_cam_obj: True,
) -> OtherPose | None:
    """The pose furthest from an answer that the observation cannot tell from it.

    None where there is none, or where one scores more than the answer by more than noise explains.

    Args:
        verifier: whose score it is.
        target: the object.
        around: the landscape of the answer: its poses within what is undetermined, and all others, are compared too.
        poses: others to compare (4, 4), such as those of the run.
        placed: other objects that may hide parts.
        is_wanted: which poses may be the other one.
    """
    answer = around.T_cam_obj

    def apart_mm(T_one: Float, T_other: Float) -> float:
        return add_s_mm(target.model, T_one, T_other)

    least_mm = APART * 1e3 * target.model.diameter_m
    sampled = [c.axis.moved(answer, x) for c in around.curves for x in (*c.offsets.tolist(), *_within(c)) if x]
    others = [T for T in (*poses, *sampled) if is_wanted(T) and apart_mm(T, answer) > least_mm]
    if not others:
        return None
    scores = verifier.score(target, np.array(others), placed).score
    chosen: list[Float] = []
    for k in np.argsort(-scores, kind="stable"):
        if len(chosen) == MOST_POSES or scores[k] < around.score - GAIN:
            break
        if all(apart_mm(others[k], T) > least_mm for T in chosen):
            chosen.append(others[k])
    if not chosen:
        return None
    T_answer, best = highest_near(verifier, target, answer, placed)
    noise = ScoreNoise(verifier, target, T_answer, placed)
    alike: list[OtherPose] = []
    for T, score in (highest_near(verifier, target, T, placed) for T in chosen):
        far_mm, spread = apart_mm(T, T_answer), noise.of(T, score.n_pixels)
        if not is_wanted(T) or far_mm <= least_mm:
            continue
        if score.score - best.score > CANNOT_TELL * spread:
            return None
        if best.score - score.score <= CANNOT_TELL * spread:
            alike.append(OtherPose(T, score.score, best.score, spread, far_mm))
    return max(alike, key=lambda other: other.apart_mm, default=None)


def _within(curve: Curve) -> list[float]:
    """More offsets of a curve where much is undetermined: its own are far apart there."""
    return np.linspace(curve.low, curve.high, MORE).tolist() if curve.width > curve.axis.steps[0] else []


def brief(around: Landscape, other: OtherPose) -> str:
    """What is undetermined: "turn about the vertical undetermined within ±25°", or how far away the other pose is."""
    widest = around.least_certain
    if widest.width > widest.axis.steps[0]:
        return widest.describe()
    return f"a pose {other.apart_mm:.0f} mm away fits as well"


def describe(name: str, around: Landscape, other: OtherPose, of_other: str = "another pose") -> str:
    """Return "The observation cannot tell the answer for the mug (score up to 0.91) from another pose 31 mm away"."""
    one, two = distinct_texts(other.score_of_answer, other.score, 3)
    return (
        f"The observation cannot tell the answer for the {name} (score up to {one}) from {of_other} "
        f"{other.apart_mm:.0f} mm away (up to {two}): the noise of the difference is ±{other.noise:.4f}; "
        f"{brief(around, other)}."
    )


def ambiguous(case: Case) -> Finding | None:
    """The observation cannot tell the answer from a correct pose, by the score of the object alone."""
    if case.answer is None or not case.lab.traits.verifies:
        return None
    if discarded(case) is not None:
        return None  # The run had a correct pose: that it was given up says more.
    placed = case.placed if case.lab.method(None).placed_may_hide else ()
    around = undetermined(case.lab.verifier, case.target, case.answer.T_cam_obj, placed)
    # Ground truth, or the answer but for a turn after which the shape nearly looks the same.
    turned = case.answer.T_cam_obj @ flips(near_symmetries(case.target.model))
    poses = [*poses_at_gt(case), *turned, *run_poses(case.target, case.trace.iterations)]

    def is_right(T_cam_obj: Float) -> bool:
        return case.error_of(T_cam_obj) < case.threshold

    other = other_pose(case.lab.verifier, case.target, around, poses, placed, is_right)
    if other is None:
        return None
    evidence = {
        "score": other.score_of_answer,
        "score_of_other": other.score,
        "score_noise": other.noise,
        "apart_mm": other.apart_mm,
        "undetermined_mm": around.undetermined_mm,
        "undetermined_deg": around.undetermined_deg,
        "error": case.error,
    }
    return Finding(Cause.AMBIGUOUS, describe(case.name, around, other, "a correct pose"), evidence, True)
