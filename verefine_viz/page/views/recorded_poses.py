"""What another program recorded of its poses, beside our scores of them: the want ``recorded``."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import rankdata

from verefine_viz.core.problem import RecordedStep, Target
from verefine_viz.core.records import Iteration
from verefine_viz.page import protocol as p
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.moment import state_of
from verefine_viz.page.workspace import Workspace

Json = dict[str, Any]
FEWEST = 4
"""Poses below which a correlation has no meaning."""


def recorded(space: Workspace, want: p.RecordedWanted, blobs: Blobs) -> Json:
    """Return the recorded poses of an object as far as the run has repeated them, and whether the scores agree.

    ``theirs`` and ``ours`` are the program's score and ours; k = 0 is an initial pose.
    """
    run = space.branch(want.branch).run
    target = run.problem.target(want.obj)
    own = state_of(run.state_at(0), target)
    scores = target.instance.recorded_scores if own is not None else ()
    starts = [] if own is None else [arm.entries[0].score.score for arm in own.arms]
    rows = [
        {"k": 0, "arm": j, "name": "initial", "theirs": theirs, "ours": ours, "ms": 0.0, "note": ""}
        for j, (theirs, ours) in enumerate(zip(scores, starts, strict=False))
    ]
    for iteration in run.iterations_of(want.obj):
        step, refined = step_of(target, iteration), iteration.stage("refined")
        if step is not None and refined is not None:
            rows.append(
                {"k": iteration.index, "arm": iteration.arm, "name": step.name, "theirs": step.score,
                 "ours": refined.score and refined.score.score, "ms": step.ms, "note": step.note}
            )  # fmt: skip
    return {"rows": rows, "rank": rank_correlation([(r["theirs"], r["ours"]) for r in rows])}


def step_of(target: Target, iteration: Iteration) -> RecordedStep | None:
    """Return the recorded step that an iteration took; None where it was computed here."""
    refined, k = iteration.stage("refined"), iteration.arm_iteration
    own = [step for step in target.instance.recorded if step.hypothesis == iteration.arm]
    if refined is None or k > len(own) or not np.array_equal(own[k - 1].T_cam_obj, refined.T_cam_obj):
        return None
    return own[k - 1]


def rank_correlation(pairs: list[tuple[float | None, float | None]]) -> float | None:
    """Return Spearman's correlation of the pairs that have both, in [-1, 1]; None where it has no meaning."""
    both = [pair for pair in pairs if None not in pair]
    if len(both) < FEWEST:
        return None
    theirs, ours = (rankdata(side) for side in zip(*both, strict=True))
    if np.ptp(theirs) == 0 or np.ptp(ours) == 0:
        return None
    return float(np.corrcoef(theirs, ours)[0, 1])
