"""What happened at the cursor, in one or two sentences. Pure text, no markup: who shows it escapes it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.records import Iteration, Stage, TreeStep
from verefine_viz.core.settings import Edit
from verefine_viz.core.text_format import distinguishing_digits
from verefine_viz.diagnosis.signs import NEAR_TIE
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.methods.registry import method_of
from verefine_viz.pictures.visited_tree import Tree, tree_of
from verefine_viz.viewer.snapshot.scene_state import ClosedPass, SceneState, labels_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.timeline_marks import FALL
from verefine_viz.viewer.text.display_names import (
    TERMS,
    arm_name,
    counted,
    in_focus,
    is_correct,
    method_name,
    refiner_name,
)
from verefine_viz.viewer.text.pose_words import errors_in_words, movement, shift_mm, starts, turn

UNVERIFIED = "without judging"
HINTS = TERMS | {
    UNVERIFIED: "As the paper defines it (Sec. III-A): the next iteration goes on from what this one ended with, "
    "whatever that scores; scores are only shown. SIR and RIR keep the better of the simulated and the refined pose.",
    "UCB": "upper confidence bound: mean score of the hypothesis so far, plus a bonus for having been tried little. "
    "The hypothesis with the highest is tried next.",
    "ICP": "iterative closest point: moves the pose until the observed points lie on the model.",
}
"""What the headline's words mean."""


def headline(snapshot: Snapshot) -> str:
    """What happened at the cursor, in one or two sentences."""
    iteration = snapshot.shown
    if snapshot.cursor == 0:
        return _ready(snapshot)
    if snapshot.is_answer:
        return _outcome(snapshot)
    if iteration is None:
        return f"{snapshot.name} has had no iteration yet."
    # At the end of a run the last iteration is asked for by its last stage.
    progress, stage = snapshot.progress, snapshot.options.stage
    is_whole = progress.done == progress.total and stage == iteration.stages[-1].name
    if stage is not None and snapshot.is_current and not is_whole:
        return _stage_sentence(snapshot, iteration)
    if iteration.tree is not None:
        words = _tree_sentence(snapshot, iteration, iteration.tree)
    else:
        words = _iteration_sentence(snapshot, iteration)
    if snapshot.scene.closes_pass is not None and snapshot.is_current:
        words += f" {_pass_closed(snapshot.scene.closes_pass)}"
    if not snapshot.is_current:
        words = f"(Latest of {snapshot.name}, the cursor is at iteration {snapshot.cursor}.) {words}"
    return words


def brief(snapshot: Snapshot) -> str:
    """The iteration at the cursor in a few words, as in: Iteration 7 · hypothesis 4 of 5 · refined · 0.31 → 0.45.

    Empty before the first one, and where the answer is shown.
    """
    iteration = snapshot.shown
    if iteration is None or snapshot.is_answer or snapshot.cursor == 0:
        return ""
    stages, several = iteration.stages, len(snapshot.scene.objects) > 1
    parts = [f"Iteration {iteration.index}", *([in_focus(snapshot).label] if several else [])]
    parts.append(f"hypothesis {iteration.arm + 1} of {snapshot.n_arms}")
    names = [stage.name for stage in stages]
    if snapshot.is_partial and snapshot.options.stage in names:
        k = names.index(snapshot.options.stage)
        reached = stages[k].score
        parts.append(f"{k + 1} of {len(names)}: {names[k]}")
        parts += [f"{reached.score:.2f}"] if reached is not None else []
    else:
        before, after = stages[0].score, iteration.accepted_stage.score
        parts.append(f"{iteration.accepted} accepted")
        if before is not None and after is not None:
            n = distinguishing_digits(abs(after.score - before.score))
            parts.append(f"{before.score:.{n}f} → {after.score:.{n}f}")
    return " · ".join(parts)


def place_in_run(scene: SceneState, iteration: Iteration) -> str:
    """As in: cluster 1 of 2, pass 3. Empty where there is one object or neither clusters nor passes."""
    if len(scene.objects) < 2:
        return ""
    parts = []
    if 1 < scene.n_clusters < len(scene.objects):
        parts.append(f"cluster {scene.object(iteration.instance_id).cluster} of {scene.n_clusters}")
    if iteration.scene_pass is not None:
        parts.append(f"pass {iteration.scene_pass}")
    return ", ".join(parts)


def cheapest_scene(tree: Tree) -> str:
    """What a tree search has found so far."""
    return (
        f"The cheapest complete scene leaves {tree.incumbent_px:,.0f} px unexplained; iteration "
        f"{tree.incumbent_iteration} found it."
    )


# Before the first iteration.

MOST = 3
"""Edited poses that are named."""


def _ready(snapshot: Snapshot) -> str:
    if snapshot.state is None:
        return (
            f"{snapshot.name} has no hypothesis, so there is nothing to refine: "
            "name a results file that holds it, or choose another object."
        )
    n_objects = len(snapshot.scene.objects)
    parts = [
        "Ready, before iteration 1.",
        f"{n_objects} objects." if n_objects > 1 else "",
        starts(snapshot),
        _edits(snapshot),
        "Press Step (N) for one iteration, Run (Space) for all.",
    ]
    return " ".join(filter(None, parts))


def _edits(snapshot: Snapshot) -> str:
    """Which hypotheses the open run has edited, when and how far, and which poses the session edits in other frames."""
    edits = snapshot.edits
    sentences = [_edit(snapshot, edit) for edit in edits[:MOST]]
    if len(edits) > MOST:
        sentences.append(f"{len(edits) - MOST} more are edited.")
    elsewhere = [edit for edit in snapshot.session.edits if edit not in edits and edit.frame != snapshot.frame]
    if elsewhere:
        sentences.append(_edits_elsewhere(elsewhere))
    return " ".join(sentences)


def _edits_elsewhere(edits: Sequence[Edit]) -> str:
    """That this frame lacks what some edits are of."""
    frames, n = sorted({edit.frame for edit in edits if edit.frame}), len(edits)
    if frames:
        where = f"frame{'s' if len(frames) > 1 else ''} {', '.join(frames)}"
        return f"{counted(n, 'edited pose')} belong{'s' * (n == 1)} to {where}."
    what = f"hypothesis {edits[0].hypothesis + 1} of instance {edits[0].instance}"
    more = f" and {n - 1} more" if n > 1 else ""
    return f"The session edits {what}{more}, which this frame does not have."


def _edit(snapshot: Snapshot, edit: Edit) -> str:
    """As in: Hypothesis 4 was edited before iteration 1, 12.0 mm and 20.0° from its initial pose."""
    o = snapshot.scene.object(edit.instance)
    who = f"Hypothesis {edit.hypothesis + 1}" + (f" of {o.label}" if len(snapshot.scene.objects) > 1 else "")
    when = "was edited before iteration 1"
    if edit.after_iteration:
        when = f"will be edited after iteration {edit.after_iteration}"
    pool = o.target.instance.hypotheses
    if edit.hypothesis >= len(pool):
        return f"{who} {when}."
    initial, edited = pool[edit.hypothesis].T_cam_obj, np.reshape(edit.T_cam_obj, (4, 4))
    moved_mm, angle_deg = shift_mm(initial, edited, o.target.model.points), turn(initial, edited)[0]
    return f"{who} {when}, {moved_mm:.1f} mm and {angle_deg:.1f}° from its initial pose."


# An iteration.


def _iteration_sentence(snapshot: Snapshot, iteration: Iteration) -> str:
    place = place_in_run(snapshot.scene, iteration)
    place = f"{place}, " if place else ""
    head = f"Iteration {iteration.index}, {place}{snapshot.name}, {_chosen_because(iteration, snapshot.n_arms)}."
    body = "; ".join(
        _what_it_did(snapshot, iteration, before, stage)
        for before, stage in pairwise(iteration.stages)
        if stage.name != "mixed"
    )
    accepted, start = iteration.accepted, iteration.stages[0].score
    end = f"{accepted.capitalize()} accepted" if accepted != "current" else "Neither was better: current pose accepted"
    if start is not None and _fell(iteration):
        end += f", although it scores less than before ({start.score:.{_digits(iteration)}f})"
    if _is_unverified(iteration):
        end += f": {method_name(snapshot.session.method.name)} accepts it {UNVERIFIED}"
    return f"{head} {_capital(body)}. {end}."


def _capital(words: str) -> str:
    """Unlike ``capitalize`` it leaves the rest as it is."""
    return words[:1].upper() + words[1:]


def _chosen_because(iteration: Iteration, n_arms: int) -> str:
    """As in: hypothesis 2 of 5 (best UCB: 0.71 + 0.09)."""
    who = f"hypothesis {iteration.arm + 1} of {n_arms}"
    choice = iteration.choice
    if choice is None:
        return who
    mean, bonus = choice.mean[iteration.arm], choice.exploration[iteration.arm]
    is_edited = any(event.kind == "edited" for event in iteration.events)  # Then it was not the bound that decided.
    if bonus > 0 and not is_edited:
        return f"{who} (best UCB: {mean:.2f} + {bonus:.2f})"
    return f"{who} ({choice.reason.partition(': ')[2] or choice.reason})"


def _is_unverified(iteration: Iteration) -> bool:
    """Whether there were two poses to choose from, and no choice was made."""
    both = iteration.stage("simulated") is not None and iteration.stage("refined") is not None
    return both and not any(event.kind in ("kept_refined", "kept_simulated", "flipped") for event in iteration.events)


def _what_it_did(snapshot: Snapshot, iteration: Iteration, before: Stage, stage: Stage) -> str:
    refiner = refiner_name(snapshot.session.method.refiner)
    if stage.name == "simulated" and iteration.path is None:
        return "there was no simulation"
    if stage.name == "simulated":
        who = "simulation"
    elif stage.name == "refined":
        who = refiner if before.name == "current" else f"then {refiner}"
    elif stage.name == "flipped":
        who = "its best flip"
    else:
        who = f"the {stage.name} stage"
    what = movement(before.T_cam_obj, stage.T_cam_obj, snapshot.target.model.points)
    if stage.score is None:
        return f"{who} {what}"
    return f"{who} {what.replace(' and ', ', ')} and scored {stage.score.score:.{_digits(iteration)}f}"


def _fell(iteration: Iteration) -> bool:
    """Whether the accepted pose scores so much less than the one before that it is said."""
    before, after = iteration.stages[0].score, iteration.accepted_stage.score
    return before is not None and after is not None and before.score - after.score >= FALL


def _digits(iteration: Iteration) -> int:
    """Decimals that tell the scores apart that are named of an iteration."""
    stages = iteration.stages if _fell(iteration) else iteration.stages[1:]
    scores = sorted(stage.score.score for stage in stages if stage.score is not None)
    return distinguishing_digits(min((b - a for a, b in pairwise(scores) if b > a), default=0.0))


def _stage_sentence(snapshot: Snapshot, iteration: Iteration) -> str:
    names = [s.name for s in iteration.stages]
    k = names.index(snapshot.options.stage) if snapshot.options.stage in names else len(names) - 1
    stage = iteration.stages[k]
    head = f"Iteration {iteration.index}, {snapshot.name}, stage {k + 1} of {len(names)}: {stage.name}."
    if k == 0:
        scored = f", which scores {stage.score.score:.{_digits(iteration)}f}" if stage.score else ""
        return f"{head} {_capital(_chosen_because(iteration, snapshot.n_arms))} goes on from its current pose{scored}."
    if stage.name == "mixed":
        return f"{head} The simulated rotation with the translation from before: where the refiner starts."
    what = _what_it_did(snapshot, iteration, iteration.stages[k - 1], stage).removeprefix("then ")
    return f"{head} {_capital(what)}."


def _tree_sentence(snapshot: Snapshot, iteration: Iteration, step: TreeStep) -> str:
    names = labels_of(snapshot.problem)
    tried = f"{names.get(iteration.instance_id, 'object')} from hypothesis {iteration.arm + 1}"
    if step.node is None:
        words = f"Iteration {iteration.index}: the branch down to {tried} was expanded before and was visited again"
    else:
        words = f"Iteration {iteration.index}: tried {tried} (LCP {step.node.lcp:.2f})"
        above = len(step.branch) - 2
        words += f" among {counted(above, 'object')} placed before" if above > 0 else ""
    rest = [names.get(p.instance_id, "object") for p in step.rollout]
    if rest:
        words += f"; a roll-out placed {rest[0] if len(rest) == 1 else f'the other {len(rest)}'}"
    words += f". The complete scene costs {step.cost_px:,.0f} px"
    if any(e.kind == "new_best_scene" for e in iteration.events):
        return f"{words}: the best so far."
    if step.cost_px <= step.incumbent_cost_px:
        return f"{words}, as few as the best so far."
    return f"{words}; the best so far {step.incumbent_cost_px:,.0f} px."


def _pass_closed(closed: ClosedPass) -> str:
    """As in: Pass 3 closed: pass score 0.71, incumbent 0.74 (pass 2)."""
    record = closed.record
    words = f"Pass {closed.number} closed: pass score {record.score.score:.2f}, "
    if closed.best_pass == closed.number:
        own_best = ", each object at its own best pose" if record.best_known.score > record.score.score else ""
        return f"{words}the incumbent is now {record.incumbent_score:.2f}{own_best}."
    where = f"pass {closed.best_pass}" if closed.best_pass else "the initial poses"
    return f"{words}incumbent {record.incumbent_score:.2f} ({where})."


# The end of a finished run: its answers, by how much the answer won, and whether the runner-up was the better pose.

WORTH_MM = 1.0
"""A runner-up that is nearer to ground truth by less is as good."""


def _outcome(snapshot: Snapshot) -> str:
    if len(snapshot.scene.objects) == 1:
        return f"Run finished: {_answer(snapshot)}"
    words = _scene_outcome(snapshot.scene) + _iteration_of_answer(snapshot)
    if snapshot.options.focus is None:
        return words
    return f"{words} {_capital(snapshot.name)}: {_answer(snapshot)}"


def _scene_outcome(scene: SceneState) -> str:
    answered = [o for o in scene.objects if o.answer is not None]
    known = [o for o in answered if o.errors is not None]
    words = f"Run finished: {len(answered)} of {len(scene.objects)} objects have a pose"
    if known:
        wrong = [o.label for o in known if not is_correct(o.errors)]
        words += f", {len(known) - len(wrong)} of {len(known)} within 10 % of their diameter"
        words += f" (not {', '.join(wrong[:3])}{', …' if len(wrong) > 3 else ''})" if wrong else ""
    return f"{words}."


def _iteration_of_answer(snapshot: Snapshot) -> str:
    """Which iteration found a finished search's answer; empty where objects were solved one by one."""
    if snapshot.scene.n_clusters > 1 or not snapshot.iterations:
        return ""
    tree = tree_of(snapshot.iterations)
    if tree is not None:
        return f" {cheapest_scene(tree)}"
    latest = snapshot.scene.latest_pass
    if latest is None:
        return ""
    where = f"found by pass {latest.best_pass}" if latest.best_pass else "the initial poses"
    return f" Incumbent {latest.record.incumbent_score:.2f}, {where}."


def _answer(snapshot: Snapshot) -> str:
    """The answer of the object in focus."""
    if snapshot.state is None:
        return "no hypothesis, so no pose."
    best, pose = in_focus(snapshot).answer, snapshot.poses["best"]
    assert best is not None
    label = pose.label if method_of(snapshot.session.method.name).verifies else "last pose"
    who = f"{label} {best.score.score:.2f}, {arm_name(snapshot.target, best.arm)}"
    where = "its initial pose" if best.iteration == 0 else f"iteration {best.iteration} ({best.stage})"
    off = f"; {errors_in_words(pose.errors)}" if pose.errors else ""
    return f"{who}, {where}{_score_margin(snapshot)}{off}."


def _score_margin(snapshot: Snapshot) -> str:
    """As in: , 0.003 ahead of hypothesis 2, which is 4.1 mm nearer to ground truth.

    The latter where ground truth is known, of a lead below ``NEAR_TIE``, measured as ADD(-S) of the two poses. Empty
    where no other hypothesis could have been the answer.
    """
    own = snapshot.finished_in_focus
    if own is None or own.answer is None or own.runner_up is None:
        return ""
    rival = own.runner_up
    is_tie = rival.lead < NEAR_TIE
    return f", {rival.in_words()}{_nearer(snapshot, own.answer.T_cam_obj, rival.pose.T_cam_obj) * is_tie}"


def _nearer(snapshot: Snapshot, T_best: Float, T_rival: Float) -> str:
    """As in: , which is 4.1 mm nearer to ground truth. Empty where it is not, or that is unknown."""
    T_gt, model = snapshot.target.instance.T_cam_obj_gt, snapshot.target.model
    if T_gt is None:
        return ""
    gain_mm = add_s_mm(model, T_best, T_gt) - add_s_mm(model, T_rival, T_gt)
    return f", which is {gain_mm:.1f} mm nearer to ground truth" if gain_mm >= WORTH_MM else ""
