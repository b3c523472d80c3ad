"""Two poses that the observation cannot tell apart: their scores differ by less than the noise of the score, and they
are further apart than 10 % of the diameter. Objects whose symmetry is not declared belong here.
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
from verefine_viz.diagnosis.score_causes import discarded
from verefine_viz.evaluation.depth_noise import ScoreNoise
from verefine_viz.evaluation.landscape import CANNOT_TELL, Curve, Landscape, undetermined
from verefine_viz.evaluation.near_symmetry import flips, near_symmetries
from verefine_viz.evaluation.pose_errors import add_s_mm

APART = 0.1
"""Poses closer to each other than this share of the diameter (ADD(-S)) count as one."""
MORE = 20
"""Offsets between the ends of what is undetermined along an axis that are looked at as well."""
MOST_POSES = 150
"""Poses of a run that are compared with its answer, the best by score."""


@dataclass(frozen=True, eq=False)
class OtherPose:
    """A pose that the observation cannot tell from an answer."""

    T_cam_obj: Float
    """(4, 4)."""
    score: float
    score_of_answer: float
    noise: float
    """Standard deviation of the difference of the two scores."""
    apart_mm: float
    """ADD(-S) between the two poses [mm]."""


def run_poses(target: Target, iterations: Iterable[Iteration]) -> list[Float]:
    """All poses (4, 4) that a run had of an object: hypotheses, and every stage of its iterations."""
    own = [i for i in iterations if i.instance_id == target.instance.instance_id]
    return [h.T_cam_obj for h in target.instance.hypotheses] + [stage.T_cam_obj for i in own for stage in i.stages]


def other_pose(
    verifier: Verifier,
    target: Target,
    around: Landscape,
    poses: Sequence[Float],
    placed: Sequence[Placed] = (),
    is_wanted: Callable[[Float], bool] = lambda T_cam_obj: True,
) -> OtherPose | None:
    """The pose furthest from an answer that the observation cannot tell from it; None where there is none.

    Args:
        verifier: whose score it is.
        target: the object.
        around: the landscape of the answer: its poses within what is undetermined, and all others, are compared too.
        poses: others to compare (4, 4), such as those of the run.
        placed: other objects that may hide parts.
        is_wanted: which poses may be the other one.
    """
    answer, diameter_mm = around.T_cam_obj, 1e3 * target.model.diameter_m

    def is_apart(T_cam_obj: Float) -> bool:
        return is_wanted(T_cam_obj) and add_s_mm(target.model, T_cam_obj, answer) > APART * diameter_mm

    sampled = [c.axis.moved(answer, x) for c in around.curves for x in (*c.offsets.tolist(), *_within(c)) if x]
    others = [T for T in (*poses, *sampled) if is_apart(T)]
    if not others:
        return None
    scores = verifier.score(target, np.array([answer, *others]), placed)
    fall = np.abs(scores.score[1:] - scores.score[0])
    noise = ScoreNoise(verifier, target, answer, placed)
    alike: list[OtherPose] = []
    for k in np.argsort(fall, kind="stable")[:MOST_POSES]:
        if fall[k] > CANNOT_TELL * noise.most:
            break
        spread = noise.of(others[k], int(scores.n_pixels[1 + k]))
        if fall[k] <= CANNOT_TELL * spread:
            apart_mm = add_s_mm(target.model, others[k], answer)
            two = float(scores.score[1 + k]), float(scores.score[0])
            alike.append(OtherPose(others[k], *two, spread, apart_mm))
    return max(alike, key=lambda other: other.apart_mm, default=None)


def _within(curve: Curve) -> list[float]:
    """More offsets of a curve where much is undetermined: its own are far apart there."""
    return np.linspace(curve.low, curve.high, MORE).tolist() if curve.width > curve.axis.steps[0] else []


def in_words(name: str, around: Landscape, other: OtherPose, of_other: str = "another pose") -> str:
    """As in: "The observation cannot tell the answer for the mug (score 0.913) from a pose 31 mm away (0.913) …"."""
    one, two = distinct_texts(other.score_of_answer, other.score, 3)
    widest = around.least_certain
    hint = f"; {widest.in_words()}: depth cannot see it" if widest.width > widest.axis.steps[0] else ""
    return (
        f"The observation cannot tell the answer for the {name} (score {one}) from {of_other} {other.apart_mm:.0f} mm "
        f"away ({two}): the noise of the difference is ±{other.noise:.4f}{hint}."
    )


def ambiguous(case: Case) -> Finding | None:
    """The observation cannot tell the answer from a correct pose, by the score of the object alone."""
    traits = case.lab.traits
    if case.answer is None or not traits.verifies or traits.has_tree or traits.takes_turns:
        return None
    if discarded(case) is not None:
        return None  # The run had a correct pose: that it was given up says more.
    placed = case.placed if case.lab.method(None).placed_may_hide else ()
    verifier, target = case.lab.verifier, case.target
    around = undetermined(verifier, target, case.answer.T_cam_obj, placed)
    # Ground truth, or the answer but for a turn after which the shape nearly looks the same.
    turned = case.answer.T_cam_obj @ flips(near_symmetries(target.model))
    poses = [case.T_gt, *turned, *run_poses(target, case.own)]

    def is_right(T_cam_obj: Float) -> bool:
        return case.error_of(T_cam_obj) < case.threshold

    other = other_pose(verifier, target, around, poses, placed, is_right)
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
    return Finding(Cause.AMBIGUOUS, in_words(case.name, around, other, "a correct pose"), evidence, True)
