"""What happened at the cursor, in one or two sentences. Pure text, no markup: who shows it escapes it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.records import Best, Iteration, Stage
from verefine_viz.core.settings import Edit
from verefine_viz.core.text_format import distinguishing_digits
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.methods.registry import method_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.timeline_marks import FALL
from verefine_viz.viewer.text.names import TERMS, arm_name, method_name, refiner_name
from verefine_viz.viewer.text.poses import errors_in_words, movement, shift_mm, starts, turn
from verefine_viz.viewer.text.scene import found_by, pass_closed, place_in_run, scene_outcome, tree_sentence

# By how much the answer won, and whether the runner-up was the better pose.

NO_LEAD = 1e-6
"""A smaller lead is none [score]."""
NEAR_TIE = 0.03
"""A smaller lead says little about which pose is better [score]. Of refined pairs on real frames, the one that scores
less is more than 1 mm nearer to ground truth in 3 of 10 where 0.01 to 0.03 lie between, in 3 of 20 up to 0.1, and never
beyond."""
WORTH_MM = 1.0
"""A runner-up that is nearer to ground truth by less is as good."""


def score_margin(view: Snapshot, best: Best) -> str:
    """As in: , 0.003 ahead of hypothesis 2, which is 4.1 mm nearer to ground truth.

    The latter where ground truth is known, of a lead below ``NEAR_TIE``, measured as ADD(-S) of the two poses. Empty
    where no other hypothesis could have been the answer.
    """
    if view.state is None or not method_of(view.session.method.name).answers_best_of_all:
        return ""
    highest = {
        j: max(arm.entries, key=lambda e: e.score.score) for j, arm in enumerate(view.state.arms) if j != best.arm
    }
    if not highest:
        return ""
    rival = max(highest, key=lambda j: highest[j].score.score)
    lead = best.score.score - highest[rival].score.score
    nearer = _nearer(view, best.T_cam_obj, highest[rival].T_cam_obj) if lead < NEAR_TIE else ""
    if lead < NO_LEAD:
        return f", level with hypothesis {rival + 1}{nearer}"
    return f", {lead:.{distinguishing_digits(lead)}f} ahead of hypothesis {rival + 1}{nearer}"


def _nearer(view: Snapshot, T_best: Float, T_rival: Float) -> str:
    """As in: , which is 4.1 mm nearer to ground truth. Empty where it is not, or that is unknown."""
    T_gt, model = view.target.instance.T_cam_obj_gt, view.target.model
    if T_gt is None:
        return ""
    gain_mm = add_s_mm(model, T_best, T_gt) - add_s_mm(model, T_rival, T_gt)
    return f", which is {gain_mm:.1f} mm nearer to ground truth" if gain_mm >= WORTH_MM else ""


# What a session moves by hand, in words.

MOST = 3
"""Moved poses that are named."""


def moved_by_hand(view: Snapshot) -> str:
    """Which hypotheses the open run moves, when and how far, and which poses the session moves in other frames.

    As in: Hypothesis 4 was moved by hand before iteration 1, 12.0 mm and 20.0° from its initial pose. "" where none is.
    """
    edits = view.edits
    said = [_one(view, edit) for edit in edits[:MOST]]
    if len(edits) > MOST:
        said.append(f"{len(edits) - MOST} more are moved by hand.")
    elsewhere = [edit for edit in view.session.edits if edit not in edits and edit.frame != view.frame]
    return " ".join((*said, *([_elsewhere(elsewhere)] if elsewhere else [])))


def _elsewhere(edits: Sequence[Edit]) -> str:
    """That this frame lacks what some edits move."""
    frames = sorted({edit.frame for edit in edits if edit.frame})
    if frames:
        where = f"frame{'s' if len(frames) > 1 else ''} {', '.join(frames)}"
        n = len(edits)
        return f"{n} pose{'s' * (n > 1)} moved by hand belong{'s' * (n == 1)} to {where}."
    what = f"hypothesis {edits[0].hypothesis + 1} of instance {edits[0].instance}"
    more = f" and {len(edits) - 1} more" if len(edits) > 1 else ""
    return f"The session moves {what}{more} by hand, which this frame does not have; the frame that has it does so."


def _one(view: Snapshot, edit: Edit) -> str:
    o = view.scene.object(edit.instance)
    who = f"Hypothesis {edit.hypothesis + 1}" + (f" of {o.label}" if len(view.scene.objects) > 1 else "")
    when = "was moved by hand before iteration 1"
    if edit.after_iteration:
        when = f"will be moved by hand after iteration {edit.after_iteration}"
    pool = o.target.instance.hypotheses
    if edit.hypothesis >= len(pool):
        return f"{who} {when}."
    first, put = pool[edit.hypothesis].T_cam_obj, np.reshape(edit.T_cam_obj, (4, 4))
    way_mm, angle_deg = shift_mm(first, put, o.target.model.points), turn(first, put)[0]
    return f"{who} {when}, {way_mm:.1f} mm and {angle_deg:.1f}° from its initial pose."


UNVERIFIED = "without judging"
HINTS = TERMS | {
    UNVERIFIED: "As the paper defines it (Sec. III-A): the next iteration goes on from what this one ended with, "
    "whatever that scores; scores are only shown. SIR and RIR keep the better of the simulated and the refined pose.",
    "UCB": "upper confidence bound: mean score of the hypothesis so far, plus a bonus for having been tried little. "
    "The hypothesis with the highest is tried next.",
    "ICP": "iterative closest point: moves the pose until the observed points lie on the model.",
}
"""What the headline's words mean."""


def headline(view: Snapshot) -> str:
    """What happened at the cursor, in one or two sentences."""
    if view.cursor == 0:
        return _ready(view)
    if view.is_answer:
        return _outcome(view)
    if view.shown is None:
        return f"{view.name} has had no iteration yet."
    # At the end of a run the last iteration is asked for by its last stage.
    whole = view.progress.done == view.progress.total and view.options.stage == view.shown.stages[-1].name
    if view.options.stage is not None and view.is_current and not whole:
        return _stage_sentence(view, view.shown)
    if view.shown.tree is not None:
        said = tree_sentence(view.problem, view.shown, view.shown.tree)
    else:
        said = _iteration_sentence(view, view.shown)
    if view.scene.closes_pass is not None and view.is_current:
        said += f" {pass_closed(view.scene.closes_pass)}"
    if not view.is_current:
        said = f"(Latest of {view.name}, the cursor is at iteration {view.cursor}.) {said}"
    return said


def _ready(view: Snapshot) -> str:
    if view.state is None:
        return (
            f"{view.name} has no hypothesis, so there is nothing to refine: "
            "name a results file that holds it, or choose another object."
        )
    n_objects = len(view.scene.objects)
    start = "Ready, before iteration 1. " + (f"{n_objects} objects. " if n_objects > 1 else "") + starts(view)
    moved = moved_by_hand(view)
    return f"{start} {moved}{' ' * bool(moved)}Press Step (N) for one iteration, Run (Space) for all."


def chosen_because(iteration: Iteration, n_arms: int) -> str:
    """As in: hypothesis 2 of 5 (best UCB: 0.71 + 0.09)."""
    who = f"hypothesis {iteration.arm + 1} of {n_arms}"
    choice = iteration.choice
    if choice is None:
        return who
    mean, bonus = choice.mean[iteration.arm], choice.exploration[iteration.arm]
    moved = any(event.kind == "edited" for event in iteration.events)  # Then it was not the bound that decided.
    if bonus > 0 and not moved:
        return f"{who} (best UCB: {mean:.2f} + {bonus:.2f})"
    return f"{who} ({choice.reason.partition(': ')[2] or choice.reason})"


def _iteration_sentence(view: Snapshot, iteration: Iteration) -> str:
    place = place_in_run(view.scene, iteration)
    place = f"{place}, " if place else ""
    head = f"Iteration {iteration.index}, {place}{view.name}, {chosen_because(iteration, view.n_arms)}."
    parts = []
    for before, stage in pairwise(iteration.stages):
        if stage.name != "mixed":
            parts.append(_what_it_did(view, iteration, before, stage))
    body = "; ".join(parts)
    accepted = iteration.accepted
    end = f"{accepted.capitalize()} accepted" if accepted != "current" else "Neither was better: current pose accepted"
    before = iteration.stages[0].score
    if before is not None and _fell(iteration):
        end += f", although it scores less than before ({before.score:.{_digits(iteration)}f})"
    if _is_unverified(iteration):
        end += f": {method_name(view.session.method.name)} accepts it {UNVERIFIED}"
    return f"{head} {body[:1].upper()}{body[1:]}. {end}."


def _is_unverified(iteration: Iteration) -> bool:
    """Whether there were two poses to choose from, and no choice was made."""
    both = iteration.stage("simulated") is not None and iteration.stage("refined") is not None
    return both and not any(event.kind in ("kept_refined", "kept_simulated") for event in iteration.events)


def _what_it_did(view: Snapshot, iteration: Iteration, before: Stage, stage: Stage) -> str:
    points = view.target.model.points
    who = {"simulated": "simulation", "refined": "then " + refiner_name(view.session.method.refiner)}.get(
        stage.name, f"the {stage.name} stage"
    )
    if stage.name == "simulated" and iteration.path is None:
        return "there was no simulation"
    if stage.name == "refined" and before.name == "current":
        who = refiner_name(view.session.method.refiner)
    done = movement(before.T_cam_obj, stage.T_cam_obj, points)
    scored = f" and scored {stage.score.score:.{_digits(iteration)}f}" if stage.score is not None else ""
    return f"{who} {done}{scored}" if " and " not in done else f"{who} {done.replace(' and ', ', ')}{scored}"


def _fell(iteration: Iteration) -> bool:
    """Whether the accepted pose scores so much less than the one before that it is said."""
    before, after = iteration.stages[0].score, iteration.accepted_stage.score
    return before is not None and after is not None and before.score - after.score >= FALL


def _digits(iteration: Iteration) -> int:
    """Decimals that tell the scores apart that are said of an iteration."""
    stages = iteration.stages if _fell(iteration) else iteration.stages[1:]
    scores = sorted(stage.score.score for stage in stages if stage.score is not None)
    return distinguishing_digits(min((b - a for a, b in pairwise(scores) if b > a), default=0.0))


def _stage_sentence(view: Snapshot, iteration: Iteration) -> str:
    names = [s.name for s in iteration.stages]
    k = names.index(view.options.stage) if view.options.stage in names else len(names) - 1
    stage = iteration.stages[k]
    head = f"Iteration {iteration.index}, {view.name}, stage {k + 1} of {len(names)}: {stage.name}."
    if k == 0:
        scored = f", which scores {stage.score.score:.{_digits(iteration)}f}" if stage.score else ""
        who = chosen_because(iteration, view.n_arms)
        return f"{head} {who[:1].upper()}{who[1:]} goes on from its current pose{scored}."
    if stage.name == "mixed":
        return f"{head} The simulated rotation with the translation from before: where the refiner starts."
    did = _what_it_did(view, iteration, iteration.stages[k - 1], stage).removeprefix("then ")
    return f"{head} {did[:1].upper()}{did[1:]}."


def _outcome(view: Snapshot) -> str:
    if len(view.scene.objects) == 1:
        return f"Run finished: {_answer(view)}"
    said = scene_outcome(view.scene) + found_by(view)
    if view.options.focus is None:
        return said
    return f"{said} {view.name[:1].upper()}{view.name[1:]}: {_answer(view)}"


def _answer(view: Snapshot) -> str:
    """The answer of the object in focus."""
    if view.state is None:
        return "no hypothesis, so no pose."
    best = view.scene.object(view.target.instance.instance_id).answer
    assert best is not None
    where = "its initial pose" if best.iteration == 0 else f"iteration {best.iteration} ({best.stage})"
    shown = view.poses["best"]
    said = f"{shown.label} {best.score.score:.2f}, {arm_name(view.target, best.arm)}, {where}{score_margin(view, best)}"
    errors = shown.errors
    return f"{said}; {errors_in_words(errors)}." if errors else f"{said}."
