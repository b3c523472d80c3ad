"""Events of an iteration that deserve a mark on the timeline, in words with numbers and units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from verefine_viz.core.geometry import angle_between
from verefine_viz.core.records import Event, Iteration, SimulatedPath, Stage, Tipping
from verefine_viz.core.text_format import distinguishing_digits
from verefine_viz.methods.arms import ObjectState
from verefine_viz.methods.single_object import Draft

STUCK_MM = 1e-6
"""A refiner that moves and turns the pose by less than this had no correspondence [mm, deg]."""

SCORE_STEP = 0.001
"""A smaller rise or fall of the score is not worth a mark [score]."""

PHYSICS_FALL = 0.2
"""A simulated pose that scores less than the pose it began with by this much or more was made worse [score].

Physics moves an object that floats or sinks in by some millimetres, which the refiner takes back: on real frames the
score falls by more than 0.1 in a quarter of all iterations. By more than 0.2 it falls in one of twenty, nearly all of
them where something is wrong: the object stands on another that is not simulated, or the plane is wrong.
"""


def events_of(iteration: Iteration, draft: Draft, before: ObjectState) -> tuple[Event, ...]:
    """The events of an iteration, given its draft and the object's state before it."""
    current = iteration.stages[0]
    simulated, refined = iteration.stage("simulated"), iteration.stage("refined")
    accepted = iteration.accepted_stage
    events: list[Event] = []
    if before.arms[iteration.arm].current.stage == "edited":
        events.append(Event("edited", f"Hypothesis {iteration.arm + 1} was edited before this iteration."))
    if draft.lacks_physics and before.n_done == 0:
        note = before.target.observation.support_note or "physics is switched off"
        events.append(Event("no_physics", f"No simulation: {note}"))
    if before.last_arm is not None and before.last_arm != iteration.arm:
        events.append(Event("arm_switched", f"Switched from hypothesis {before.last_arm + 1} to {iteration.arm + 1}."))
    if iteration.path is not None and iteration.path.tipping is not None:
        events.append(_unstable(iteration.path, iteration.path.tipping))
    events.extend(_worse_by_physics(iteration))
    start = iteration.before_refined
    if refined is not None and start is not None:
        moved = 1e3 * math.dist(refined.T_cam_obj[:3, 3].tolist(), start.T_cam_obj[:3, 3].tolist())
        turned = math.degrees(angle_between(start.T_cam_obj[:3, :3], refined.T_cam_obj[:3, :3]))
        if moved < STUCK_MM and turned < STUCK_MM and draft.why_stuck:
            events.append(Event("refiner_stuck", f"The refiner did not move: {draft.why_stuck}."))
    for stage in iteration.stages:
        if stage.score is not None and stage.score.undefined:
            events.append(Event("nan_score", f"The score of the {stage.name} pose is not a number: it counts as 0."))
        if stage.score is not None and stage.score.n_rendered == 0:
            events.append(Event("empty_render", f"The {stage.name} pose renders to nothing: outside of the image."))
    if accepted.name == "flipped":
        events.append(_flipped(accepted, [s for s in iteration.stages if s.name in draft.candidates]))
    elif len(draft.candidates) > 1 and simulated is not None and refined is not None:
        events.append(_accepted(accepted, simulated, refined))
    if current.score and accepted.score:
        was, now = current.score.score, accepted.score.score
        if was - now >= SCORE_STEP:
            events.append(Event("score_fell", f"The score fell by {was - now:.3f}, {was:.3f} → {now:.3f}."))
    # A method that answers with its last pose may have had a higher score before.
    highest = max(before.best.score.score, max(e.score.score for arm in before.arms for e in arm.entries))
    if iteration.best.iteration == iteration.index and iteration.best.score.score - highest >= SCORE_STEP:
        text = f"New best: {iteration.best.score.score:.3f}, was {highest:.3f}."
        events.append(Event("new_best", text))
    return tuple(events)


def _unstable(path: SimulatedPath, tipping: Tipping) -> Event:
    n_steps = len(path.Ts_cam_obj) - 1
    turned_deg = math.degrees(angle_between(path.Ts_cam_obj[0, :3, :3], path.T_cam_obj[:3, :3]))
    verb, was = ("Would tip", "is") if tipping.step == n_steps else ("Tipped over", "was")
    when = f"after step {tipping.step} of {n_steps} of the simulation"
    outside = f"the centre of mass {was} {1e3 * tipping.overhang_m:.1f} mm outside its support"
    return Event("unstable", f"{verb}: {when} {outside}; all in all it turned by {turned_deg:.1f}°.")


def _worse_by_physics(iteration: Iteration) -> list[Event]:
    for before, after in pairwise(iteration.stages):
        if after.name == "simulated" and before.score is not None and after.score is not None:
            was, now = before.score.score, after.score.score
            if was - now >= PHYSICS_FALL:
                text = f"Physics made it worse: the simulated pose scores {now:.2f}, the {before.name} one {was:.2f}."
                return [Event("physics_worse", text)]
    return []


def _flipped(flipped: Stage, candidates: Sequence[Stage]) -> Event:
    scores = {s.name: s.score.score for s in (flipped, *candidates) if s.score is not None}
    other = max(candidates, key=lambda s: scores[s.name])
    digits = max(3, distinguishing_digits(scores["flipped"] - scores[other.name]))
    one, two = (f"{scores[s.name]:.{digits}f}" for s in (flipped, other))
    turn_deg = math.degrees(angle_between(other.T_cam_obj[:3, :3], flipped.T_cam_obj[:3, :3]))
    return Event("flipped", f"Flip accepted: turned by {turn_deg:.0f}° it scores {one}, the {other.name} pose {two}.")


def _accepted(accepted: Stage, simulated: Stage, refined: Stage) -> Event:
    known = {s.name: s.score.score for s in (simulated, refined) if s.score is not None}
    digits = max(3, distinguishing_digits(max(known.values()) - min(known.values()))) if known else 3
    scores = ", ".join(f"{name} {score:.{digits}f}" for name, score in known.items())
    if accepted.name == "refined":
        return Event("kept_refined", f"Refined pose accepted ({scores}).")
    return Event("kept_simulated", f"Refined pose rejected, {accepted.name} accepted ({scores}).")
