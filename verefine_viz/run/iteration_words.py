"""Describes an iteration in one or two short sentences, for page and recordings, with the names that they use."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, rotation_vector
from verefine_viz.core.problem import Hypothesis, RecordedStep, Target
from verefine_viz.core.records import Iteration, Stage, TreeStep
from verefine_viz.core.surroundings import SUPPORT_ID, unknown_number
from verefine_viz.core.text_format import distinguishing_digits

_AXES = ("x", "y", "z")
_NO_TURN_DEG = 0.05
_NO_MOVE_MM = 0.05
_REFINERS = {
    "icp": "ICP",
    "trimmed_icp": "trimmed ICP",
    "depth_net": "depth net",
    "depth_net_icp": "depth net + ICP",
    "densefusion": "DenseFusion",
    "recorded": "the program",
}


def refiner_name(name: str) -> str:
    """Return a refiner's name as people write it."""
    return _REFINERS.get(name, name.replace("_", " "))


def source_of(hypothesis: Hypothesis) -> str:
    """Return the source of a hypothesis, without the number of a disturbed pose."""
    return re.sub(r" #\d+$", "", hypothesis.source)


def name_of_contact(instance_id: int, labels: Mapping[int, str]) -> str:
    """Name what an object touches: another object, the table, or an unknown object."""
    if instance_id > SUPPORT_ID:
        return labels.get(instance_id, f"object {instance_id}")
    number = unknown_number(instance_id)
    return "table" if number is None else f"unknown object {number}"


def turned_by(T_from: Float, T_to: Float) -> tuple[float, str]:
    """Return the angle between two poses [deg] and the object's axis of this turn: "x", or "" for another axis."""
    vector = rotation_vector(T_from[:3, :3].T @ T_to[:3, :3])
    angle = float(np.linalg.norm(vector))
    if angle < 1e-9:
        return 0.0, ""
    k = int(np.argmax(np.abs(vector)))
    return float(np.rad2deg(angle)), _AXES[k] if abs(vector[k]) > 0.9 * angle else ""


def moved_by_mm(T_from: Float, T_to: Float, points: Float) -> float:
    """Return how far the middle of the object's ``points`` (n, 3) moved between two poses [mm]."""
    centre = points.mean(axis=0)[None]
    return float(np.linalg.norm(apply(T_to, centre) - apply(T_from, centre))) * 1e3


def movement(T_from: Float, T_to: Float, points: Float) -> str:
    """Describe what happened between two poses: "turned it 6.8° about x, moved it 4.1 mm"."""
    angle, axis = turned_by(T_from, T_to)
    distance = moved_by_mm(T_from, T_to, points)
    parts = []
    if angle >= _NO_TURN_DEG:
        parts.append(f"turned it {angle:.1f}°{f' about {axis}' * bool(axis)}")
    if distance >= _NO_MOVE_MM:
        parts.append(f"moved it {distance:.1f} mm")
    return ", ".join(parts) or "left it where it was"


def brief(iteration: Iteration, n_arms: int) -> str:
    """Sum an iteration up: "hypothesis 4 of 5 · refined accepted · 0.31 → 0.45".

    ``n_arms``: how many hypotheses the method works on.
    """
    before, after = iteration.stages[0].score, iteration.accepted_stage.score
    parts = [f"hypothesis {iteration.arm + 1} of {n_arms}", f"{iteration.accepted} accepted"]
    if before is not None and after is not None:
        n = distinguishing_digits(abs(after.score - before.score))
        was, now = f"{before.score:.{n}f}", f"{after.score:.{n}f}"
        parts.append(f"score {now} as before" if was == now else f"{was} → {now}")
    return " · ".join(parts)


def step_of(target: Target, iteration: Iteration) -> RecordedStep | None:
    """Return the recorded step of another program that an iteration repeats; None where it was computed here."""
    refined, k = iteration.stage("refined"), iteration.arm_iteration
    own = [step for step in target.instance.recorded if step.hypothesis == iteration.arm]
    if refined is None or k > len(own) or not np.array_equal(own[k - 1].T_cam_obj, refined.T_cam_obj):
        return None
    return own[k - 1]


def sentence(iteration: Iteration, target: Target, refiner: str, labels: Mapping[int, str]) -> str:
    """Say why the hypothesis was chosen, what each stage did, and what was accepted.

    Args:
        iteration: the iteration.
        target: its object.
        refiner: name of the session's refiner.
        labels: names of objects, by instance.
    """
    if iteration.tree is not None:
        return _tree_sentence(iteration, iteration.tree, labels)
    did = [stage_sentence(iteration, k, target, refiner) for k in range(1, len(iteration.stages))]
    parts = [_chosen_because(iteration), *filter(None, did)]
    accepted = "nothing was better: current pose" if iteration.accepted == "current" else iteration.accepted
    words = f"{'; '.join(filter(None, parts))}. Accepted: {accepted}."
    return words[:1].upper() + words[1:]


def _chosen_because(iteration: Iteration) -> str:
    """Say why the bandit chose the hypothesis; "" where there was no choice."""
    choice = iteration.choice
    if choice is None:
        return ""
    mean, bonus = choice.mean[iteration.arm], choice.exploration[iteration.arm]
    is_edited = any(event.kind == "edited" for event in iteration.events)  # The bound did not decide.
    if bonus > 0 and not is_edited:
        return f"best UCB: mean {mean:.2f} + bonus {bonus:.2f}"
    return choice.reason.partition(": ")[2] or choice.reason


def stage_sentence(iteration: Iteration, k: int, target: Target, refiner: str) -> str:
    """Describe stage ``k``; "" where it did nothing to mention."""
    if k == 0:
        return _chosen_because(iteration)
    before, stage = iteration.stages[k - 1], iteration.stages[k]
    if stage.name == "mixed":
        return ""
    if stage.name == "simulated" and iteration.path is None:
        return "no simulation"
    what = movement(before.T_cam_obj, stage.T_cam_obj, target.model.points)
    actor = _actor(stage, refiner if step_of(target, iteration) is None else "recorded")
    return f"{actor} {what}{_scored(iteration, stage)}"


def _actor(stage: Stage, refiner: str) -> str:
    names = {"simulated": "simulation", "refined": refiner_name(refiner), "flipped": "its best flip"}
    return names.get(stage.name, f"the {stage.name} stage")


def _scored(iteration: Iteration, stage: Stage) -> str:
    if stage.score is None:
        return ""
    scores = sorted(s.score.score for s in iteration.stages if s.score is not None)
    n = distinguishing_digits(min((b - a for a, b in pairwise(scores) if b > a), default=0.0))
    return f", scored {stage.score.score:.{n}f}"


def _tree_sentence(iteration: Iteration, step: TreeStep, labels: Mapping[int, str]) -> str:
    tried = f"{labels.get(iteration.instance_id, 'object')} from hypothesis {iteration.arm + 1}"
    words = f"Visited {tried} again" if step.node is None else f"Tried {tried} (LCP {step.node.lcp:.2f})"
    if step.rollout:
        words += f"; a roll-out placed {len(step.rollout)} more"
    words += f". The complete scene leaves {step.cost_px:,.0f} px unexplained"
    is_best = step.cost_px <= step.incumbent_cost_px
    return f"{words}: the best so far." if is_best else f"{words}; the best so far {step.incumbent_cost_px:,.0f} px."
