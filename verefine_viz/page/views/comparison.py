"""Two branches side by side: pairs of iterations, the first differences, and which answer is nearer: the want
``compare``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import (
    BothEfforts,
    CompareAnswer,
    ComparedAnswer,
    DifferingSetting,
    ObjectInBoth,
    RunDeparture,
    RunEffort,
    RunPair,
)
from verefine_viz.page.blobs import Blobs
from verefine_viz.run.compare import (
    ComparedObject,
    Departure,
    Departures,
    Effort,
    ScoredBest,
    aligned,
    departures,
    effort_of,
    outcomes,
)
from verefine_viz.run.variants import scores_alike, settings_between

if TYPE_CHECKING:
    from verefine_viz.page.branch import Branch
    from verefine_viz.page.workspace import Workspace


def comparison(space: Workspace, want: p.ComparisonWanted, blobs: Blobs) -> CompareAnswer:
    """Return how two branches compare, as far as both are computed."""
    a, b = space.branch(want.a), space.branch(want.b)
    pairs = aligned(a.run.iterations, b.run.iterations)
    alike, between = scores_alike(a.settings, b.settings), settings_between(a.settings, b.settings)
    evaluator, ids_a = a.final_evaluator, {i.instance_id for i in a.run.problem.instances}

    def score_of(target: Target, best: Best) -> float:
        """B's pose scored by the rule of A, whose target of the same object may count other masks."""
        own = target.instance.instance_id
        return evaluator.score(a.run.problem.target(own) if own in ids_a else target, best.T_cam_obj).score

    answers = outcomes(a.run, b.run, evaluator.errors, None if alike else score_of)
    differences = departures(a.run, b.run, pairs)
    effort_a, effort_b = effort_of(a.run), effort_of(b.run)
    return CompareAnswer(
        names=names_of(a, b),
        settings=[DifferingSetting(name, _plain(one), _plain(other)) for name, one, other in between],
        scores_alike=alike,
        pairs=[RunPair(*pair) for pair in pairs],
        departures=[_departure(one) for one in differences if one is not None],
        words=_describe_departure(differences, min(effort_a.iterations, effort_b.iterations)),
        rows=[_outcome(o, alike) for o in answers],
        frame=_frame_scores(a, b, answers),
        effort=BothEfforts(_effort(effort_a), _effort(effort_b)),
    )


def names_of(a: Branch, b: Branch) -> tuple[str, str]:
    """Name two branches by what tells them apart, as short as can be: "rir" and "sir", "c = 0.7" and "c = 0.1"."""
    changed = {name: (one, other) for name, one, other in settings_between(a.settings, b.settings)}
    pairs = [tuple(map(str, changed[name])) for name in ("method.name", "preset") if name in changed]
    if not pairs:
        pairs = [
            tuple(f"{name.rpartition('.')[2]} = {_plain(value)}" for value in both)
            for name, both in [*changed.items()][:2]
        ]
    if not pairs:
        return a.name, b.name if b.name != a.name else f"{b.name} (2)"
    name_a, name_b = (
        ", ".join((*parts, side.recording.name) if side.recording else parts)
        for parts, side in zip(zip(*pairs, strict=True), (a, b), strict=True)
    )
    return name_a, name_b


def _describe_departure(differences: Departures, n_both: int) -> str:
    """Say where two runs diverge: "A and B do the same for 1 iteration. Then in iteration 2 B works on hypothesis
    3.".
    """
    deed, score = differences.deed, differences.score
    if deed is not None:
        same = deed.place - 1
        if deed.place < 2:
            begin = "part at once:" if deed.place else "begin differently:"
        else:
            begin = f"do the same for {same} iteration{'s' if same > 1 else ''}. Then"
        did = f"B {deed.text}" if deed.place == 0 or deed.kind == "missing" else f"{_at(deed)} B {deed.text}"
        return f"A and B {begin} {did}."
    if score is not None:
        return f"A and B reach the same poses, but score them differently: {_at(score)}, B {score.text}."
    if n_both == 0:
        return "A and B start from the same poses."
    return f"A and B did the same in all {n_both} iterations that both have made, bit for bit."


def _at(departure: Departure) -> str:
    if departure.a is None or departure.b is None:
        return "before iteration 1" if departure.place == 0 else f"in iteration {departure.a or departure.b}"
    if departure.a == departure.b:
        return f"in iteration {departure.a}"
    return f"in iteration {departure.b} (A's {departure.a})"


def _departure(departure: Departure) -> RunDeparture:
    return RunDeparture(departure.place, departure.kind, departure.text, departure.a, departure.b)


def _outcome(o: ComparedObject, alike: bool) -> ObjectInBoth:
    """Return one object's answers in both runs; which is nearer only where that is known."""
    is_known = o.a is not None and o.b is not None and o.a.errors is not None and o.b.errors is not None
    return ObjectInBoth(o.instance_id, o.name, _side(o.a), _side(o.b), o.winner if alike or is_known else None)


def _side(answer: ScoredBest | None) -> ComparedAnswer | None:
    if answer is None:
        return None
    errors = answer.errors
    return ComparedAnswer(
        score=answer.best.score.score,
        score_by_a=answer.score,
        err=None if errors is None else errors.add_s_mm,
        deg=None if errors is None else errors.rotation_deg,
        mm=None if errors is None else errors.translation_mm,
        k=answer.best.iteration,
        arm=answer.best.arm,
    )


def _frame_scores(a: Branch, b: Branch, answers: Sequence[ComparedObject]) -> tuple[float, float] | None:
    """Return the scores of A's answers and of B's, each set as one scene; None for a single object.

    Scored with the settings of A; B's with its own where they differ.
    """
    both = [(o.instance_id, o.a.best, o.b.best) for o in answers if o.a is not None and o.b is not None]
    if len(both) < 2:
        return None

    def scored(branch: Branch, poses: list[Float]) -> float:
        targets = [branch.run.problem.target(own) for own, _, _ in both]
        of_frame = branch.settings.method.scene_pixels == "frame"
        return branch.final_evaluator.scene_score(targets, np.array(poses), of_frame).score

    of_b = a if scores_alike(a.settings, b.settings) else b
    return scored(a, [one.T_cam_obj for _, one, _ in both]), scored(of_b, [other.T_cam_obj for _, _, other in both])


def _effort(effort: Effort) -> RunEffort:
    return RunEffort(effort.iterations, effort.planned, effort.refiner_calls, effort.rollout_calls, effort.ms)


def _plain(value: Any) -> str:
    words = f"{value:g}" if isinstance(value, float) else str(value)
    return words if len(words) <= 40 else f"{words[:39]}…"
