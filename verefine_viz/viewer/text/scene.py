"""Sentences in plain words about several objects at once. Pure text: who shows it escapes it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Iteration, TreeStep
from verefine_viz.pictures.visited_tree import tree_of
from verefine_viz.viewer.snapshot.scene_state import ClosedPass, SceneState, labels_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.names import is_correct

if TYPE_CHECKING:
    from verefine_viz.viewer.snapshot.snapshot import Snapshot


def scene_outcome(scene: SceneState) -> str:
    """How a finished run came out, over all objects."""
    answered = [o for o in scene.objects if o.answer is not None]
    known = [o for o in answered if o.errors is not None]
    said = f"Run finished: {len(answered)} of {len(scene.objects)} objects have a pose"
    if known:
        wrong = [o.label for o in known if not is_correct(o.errors)]
        said += f", {len(known) - len(wrong)} of {len(known)} within 10 % of their diameter"
        said += f" (not {', '.join(wrong[:3])}{', …' if len(wrong) > 3 else ''})" if wrong else ""
    return f"{said}."


def found_by(view: Snapshot) -> str:
    """Which iteration found a finished search's answer; empty where objects were solved one by one."""
    if view.scene.n_clusters > 1 or not view.iterations:
        return ""
    tree = tree_of(view.iterations)
    if tree is not None:
        return (
            f" The cheapest complete scene leaves {tree.incumbent_px:,.0f} px unexplained; iteration "
            f"{tree.incumbent_iteration} found it."
        )
    latest = view.scene.latest_pass
    if latest is None:
        return ""
    where = f"found by pass {latest.best_pass}" if latest.best_pass else "the initial poses"
    return f" Incumbent {latest.record.incumbent_score:.2f}, {where}."


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


def pass_closed(closed: ClosedPass) -> str:
    """As in: Pass 3 closed: pass score 0.71, incumbent 0.74 (pass 2)."""
    record = closed.record
    said = f"Pass {closed.number} closed: pass score {record.score.score:.2f}, "
    if closed.best_pass == closed.number:
        said += f"the incumbent is now {record.incumbent_score:.2f}"
        if record.best_known.score > record.score.score:
            said += ", each object at its own best pose"
        return said + "."
    where = f"pass {closed.best_pass}" if closed.best_pass else "the initial poses"
    return f"{said}incumbent {record.incumbent_score:.2f} ({where})."


def tree_sentence(problem: Problem, iteration: Iteration, step: TreeStep) -> str:
    """What one iteration of a tree search did."""
    names = labels_of(problem)
    tried = f"{names.get(iteration.instance_id, 'object')} from hypothesis {iteration.arm + 1}"
    if step.node is None:
        said = f"Iteration {iteration.index}: the branch down to {tried} was expanded before and was visited again"
    else:
        said = f"Iteration {iteration.index}: tried {tried} (LCP {step.node.lcp:.2f})"
        above = len(step.branch) - 2
        said += f" among {above} object{'s' if above != 1 else ''} placed before" if above > 0 else ""
    rest = [names.get(p.instance_id, "object") for p in step.rollout]
    if rest:
        said += f"; a roll-out placed {rest[0] if len(rest) == 1 else f'the other {len(rest)}'}"
    said += f". The complete scene costs {step.cost_px:,.0f} px"
    if any(e.kind == "new_best_scene" for e in iteration.events):
        return f"{said}: the best so far."
    if step.cost_px <= step.incumbent_cost_px:
        return f"{said}, as few as the best so far."
    return f"{said}; the best so far {step.incumbent_cost_px:,.0f} px."


def overlap_sentence(found: Any, scene: SceneState) -> str:
    """As in: can sinks 12 mm into box."""
    names = {o.instance_id: o.label for o in scene.objects}
    return f"{names.get(found.first, 'object')} sinks {found.depth_mm:.0f} mm into {names.get(found.second, 'object')}"


def scene_sentence(view: Snapshot) -> str:
    """What the numbers of the whole scene mean."""
    a, b = view.a, view.b
    n = len(view.scene.objects)
    if a is None or b is None or a.pose.score is None or b.pose.score is None:
        return f"The whole scene of {n} objects."
    one, other = a.pose.score.score, b.pose.score.score
    if view.is_answer:
        return f"Frame score: {other:.3f} with all {n} objects at their answers, {one:.3f} at their initial poses."
    latest = view.scene.closes_pass
    stand = f"as pass {latest.number} left them" if latest else "as they stand now"
    return f"Frame score: {other:.3f} with all {n} objects at their answers so far, {one:.3f} {stand}."


# The sentence above the list of objects: how far each of them is.


def objects_words(view: Snapshot) -> str:
    """As in: cereal is worked on, 2 are done, 3 wait."""
    objects = view.scene.objects
    if view.is_answer:
        known = [is_correct(o.errors) for o in objects if o.errors is not None]
        if known:
            return f"{sum(known)} of {len(objects)} answers are within 10 % of the diameter."
        return f"{sum(o.answer is not None for o in objects)} of {len(objects)} have an answer."
    working = [o.label for o in objects if o.phase == "working"]
    n = {
        phase: sum(o.phase == phase for o in objects)
        for phase in ("done", "placed", "rolled out", "waiting", "no pose")
    }
    said = [f"{label} is worked on" for label in working]
    for count, one, many in (
        (n["done"], "is done", "are done"),
        (n["placed"], "is placed", "are placed"),
        (n["rolled out"], "is a guess of the search", "are guesses of the search"),
        (n["waiting"], "waits", "wait"),
        (n["no pose"], "has no initial pose", "have no initial pose"),
    ):
        if count:
            said.append(f"{count} {one if count == 1 else many}")
    return f"{', '.join(said)}."
