"""Several groups of runs beside each other: a line each, with intervals, the best first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import VerefineError
from verefine_viz.evaluation.bop_scores import bop_scores
from verefine_viz.evaluation.ground_truth import Targets
from verefine_viz.evaluation.pose_table import pose_table
from verefine_viz.methods.registry import method_of
from verefine_viz.report.bootstrap import Cells, Draws, Spread, draws
from verefine_viz.report.bop_recalls import asked, measured_on, run_rows
from verefine_viz.report.groups import Group, seeds_of
from verefine_viz.report.object_results import Axes, Outcomes, axes_of, outcomes_of
from verefine_viz.report.run_results import Loaded, stage_times
from verefine_viz.scenes.frames import parse_frame

# BOP's average recall frame by frame, of many runs at once.


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
            image = parse_frame(frame)
            tables = [pose_table(run.method, list(run_rows(run, (frame,)))) for run in having[frame]]
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


@dataclass(frozen=True, eq=False)
class Curve:
    """Recall over the thresholds of ``numbers.THRESHOLDS``."""

    recall: Float
    band: tuple[Float, Float] | None
    """Its 95 % interval."""


@dataclass(frozen=True, eq=False)
class Line:
    """One group in numbers. None = nobody can say."""

    group: Group
    n_objects: int
    n_with_truth: int
    n_failed_frames: int
    recall: Spread | None
    """Share of the objects with ground truth whose ADD(-S) is below 10 % of the diameter."""
    behind: Spread | None
    """Recall less that of the best group, over the frames and seeds of both; None of the best itself."""
    ar: Spread | None
    mean_mm: Spread | None
    """ADD(-S), over the objects that got an answer, as the other errors."""
    median_mm: Spread | None
    rotation_deg: Spread | None
    translation_mm: Spread | None
    score: Spread | None
    ms_per_frame: Spread | None
    """Computing time of the iterations for all objects of a frame, median: the first frame of a worker may compile."""
    calls: Spread | None
    """Refiner calls for an object."""
    curve: Curve | None
    causes: dict[str, int]
    """Failures by cause."""
    stages_ms: dict[str, float]
    """Time a frame by stage: the median of the runs' means."""

    @property
    def name(self) -> str:
        return self.group.name


@dataclass(frozen=True, eq=False)
class Comparison:
    """All groups."""

    lines: tuple[Line, ...]
    """Best recall first; without ground truth by name."""
    axes: Axes
    bop_note: str
    """What BOP scores are over, or why there are none."""

    @property
    def has_truth(self) -> bool:
        return any(line.recall is not None for line in self.lines)

    @property
    def has_ar(self) -> bool:
        return any(line.ar is not None for line in self.lines)

    @property
    def groups(self) -> tuple[Group, ...]:
        return tuple(line.group for line in self.lines)


def compare(groups: Sequence[Group], bop: FrameRecalls) -> Comparison:
    """Everything that is said about the groups as a whole."""
    axes = axes_of(groups)
    drawn = draws(*axes.shape)
    outcomes = [outcomes_of(group, axes) for group in groups]
    recalls = [mine.recall for mine in outcomes]
    best = max(range(len(groups)), key=lambda k: (recalls[k].mean or -1.0, -_mean_error(outcomes[k])))
    lines = [
        _line(group, mine, drawn, None if k == best else recalls[best], bop.cells(group.runs, axes))
        for k, (group, mine) in enumerate(zip(groups, outcomes, strict=True))
    ]
    if any(line.recall is not None for line in lines):
        lines.sort(
            key=lambda line: (-1.0 if line.recall is None else line.recall.value, line.behind is None), reverse=True
        )
    return Comparison(tuple(lines), axes, bop.note)


def _line(group: Group, mine: Outcomes, drawn: Draws, best: Cells | None, ar: Cells | None) -> Line:
    recall = mine.recall
    solved = mine.add_s_mm == mine.add_s_mm
    hits = mine.hits
    n = float(recall.n.sum())
    return Line(
        group=group,
        n_objects=len(mine.unit),
        n_with_truth=int(n),
        n_failed_frames=sum(len({row.frame for row in run.rows if row.status == "failed"}) for run in group.runs),
        recall=drawn.mean(recall),
        behind=None if best is None else drawn.difference(recall, best),
        ar=None if ar is None else drawn.mean(ar),
        mean_mm=drawn.mean(mine.cells(mine.add_s_mm)),
        median_mm=drawn.median(mine.add_s_mm[solved], mine.unit[solved], mine.seed[solved]),
        rotation_deg=drawn.mean(mine.cells(mine.rotation_deg)),
        translation_mm=drawn.mean(mine.cells(mine.translation_mm)),
        score=drawn.mean(mine.cells(mine.score)),
        ms_per_frame=drawn.median(*mine.frame_times),
        calls=None if method_of(group.method).has_tree else drawn.mean(mine.cells(mine.calls)),
        curve=Curve(hits.sum(axis=(0, 1)) / n, drawn.band(hits, recall.n)) if n else None,
        causes=dict(Counter(row.cause for run in group.runs if run.with_truth for row in run.failures)),
        stages_ms=_stages(group),
    )


def _mean_error(mine: Outcomes) -> float:
    mean = mine.cells(mine.add_s_mm).mean
    return float("inf") if mean is None else mean


def _stages(group: Group) -> dict[str, float]:
    times = [stage_times(run) for run in group.runs]
    stages = dict.fromkeys(stage for mine in times for stage in mine)
    return {stage: float(np.median([mine.get(stage, 0.0) for mine in times if mine])) for stage in stages}
