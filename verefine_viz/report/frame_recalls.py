"""BOP's average recall frame by frame, of many runs at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from verefine_viz.batch.rows import frame_ids
from verefine_viz.core.errors import VerefineError
from verefine_viz.evaluation.bop_scores import bop_scores
from verefine_viz.evaluation.pose_table import pose_table
from verefine_viz.evaluation.targets import Targets
from verefine_viz.report.bop import asked, measured_on, result_rows
from verefine_viz.report.groups import seeds_of
from verefine_viz.report.loaded import Loaded
from verefine_viz.report.outcomes import Axes
from verefine_viz.report.spread import Cells


@dataclass(frozen=True, eq=False)
class FrameRecalls:
    """Average recall of each frame of several runs, or why there is none."""

    found: dict[tuple[Path, str], tuple[int, float]] = field(default_factory=dict)
    """Folder of the run and frame → instances asked for, AR over them."""
    note: str = ""
    """What was asked for; or, without recalls, what is missing for them."""

    def cells(self, runs: Sequence[Loaded], axes: Axes) -> Cells | None:
        """AR by frame and seed of some runs; None where nothing was asked for."""
        total, n = np.zeros(axes.shape), np.zeros(axes.shape)
        for run in runs:
            for frame in run.frames:
                n_targets, ar = self.found.get((run.folder, frame), (0, 0.0))
                place = axes.unit_of[frame], axes.seed_of[seeds_of(run)]
                total[place] += n_targets * ar
                n[place] += n_targets
        return Cells(total, n) if n.any() else None


def frame_recalls(
    runs: Sequence[Loaded], workers: int = 1, tell: Callable[[int, int], None] = lambda done, of: None
) -> FrameRecalls:
    """The average recall of each frame in each run; images are read, and true poses drawn, once for all runs.

    Runs are asked for what the first one was about, in the frames that they have.
    """
    if not any(run.with_truth for run in runs):
        return FrameRecalls(note="BOP scores need ground truth, which this data does not have.")
    having: dict[str, list[Loaded]] = {}
    for run in runs:
        for frame in run.frames:
            having.setdefault(frame, []).append(run)
    found: dict[tuple[Path, str], tuple[int, float]] = {}
    try:
        truth, targets = asked(runs[0], tuple(having))
        # Threads share the models: they are read before.
        for obj_id in sorted({i for counts in targets.counts.values() for i in counts}):
            truth.model(obj_id)

        def solve(frame: str) -> dict[tuple[Path, str], tuple[int, float]]:
            image = frame_ids(frame)
            tables = [pose_table(run.method, list(result_rows(run, (frame,)))) for run in having[frame]]
            alone = Targets(targets.name, {image: targets.counts[image]}, targets.task)
            recalls = [scores.recalls for scores in bop_scores(tables, truth, alone, "localization")]
            return {
                (run.folder, frame): (r.n_targets, r.ar) for run, r in zip(having[frame], recalls, strict=True) if r
            }

        with ThreadPoolExecutor(workers) as pool:
            for done, part in enumerate(pool.map(solve, having), start=1):
                found |= part
                tell(done, len(having))
    except VerefineError as error:
        return FrameRecalls(note=f"No BOP scores: {error}.")
    return FrameRecalls(found, measured_on(truth, targets))
