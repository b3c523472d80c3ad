"""What another program recorded of its poses, beside our scores of them: the want ``recorded``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import RecordedAnswer, RecordedPose
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.frame_objects import state_of
from verefine_viz.run.iteration_words import step_of

if TYPE_CHECKING:
    from verefine_viz.page.workspace import Workspace

FEWEST = 4
"""Poses below which a correlation has no meaning."""


def recorded(space: Workspace, want: p.RecordedWanted, blobs: Blobs) -> RecordedAnswer:
    """Return the recorded poses of an object as far as the run has repeated them, and whether the scores agree.

    ``theirs`` and ``ours`` are the program's score and ours; k = 0 is an initial pose.
    """
    run = space.branch(want.branch).run
    target = run.problem.target(want.obj)
    own = state_of(run.state_at(0), target)
    scores = target.instance.recorded_scores if own is not None else ()
    starts = [] if own is None else [arm.entries[0].score.score for arm in own.arms]
    rows = [
        RecordedPose(k=0, arm=j, name="initial", theirs=theirs, ours=ours, ms=0.0, note="")
        for j, (theirs, ours) in enumerate(zip(scores, starts, strict=False))
    ]
    for iteration in run.iterations_of(want.obj):
        step, refined = step_of(target, iteration), iteration.stage("refined")
        if step is not None and refined is not None:
            ours = refined.score and refined.score.score
            rows.append(RecordedPose(iteration.index, iteration.arm, step.name, step.score, ours, step.ms, step.note))
    return RecordedAnswer(rows, _rank_correlation([(row.theirs, row.ours) for row in rows]))


def _rank_correlation(pairs: list[tuple[float | None, float | None]]) -> float | None:
    """Return Spearman's correlation of the pairs that have both, in [-1, 1]; None where it has no meaning."""
    both = [pair for pair in pairs if None not in pair]
    if len(both) < FEWEST:
        return None
    from scipy.stats import rankdata  # half a second to import

    theirs, ours = (rankdata(side) for side in zip(*both, strict=True))
    if np.ptp(theirs) == 0 or np.ptp(ours) == 0:
        return None
    return float(np.corrcoef(theirs, ours)[0, 1])
