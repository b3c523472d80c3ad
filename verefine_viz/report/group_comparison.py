"""Several groups of runs compared: a line each, with intervals, the best first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.methods.registry import method_of
from verefine_viz.report.bootstrap import Cells, Draws, Spread, draws
from verefine_viz.report.bop_recalls import FrameRecalls
from verefine_viz.report.groups import Group
from verefine_viz.report.object_results import Axes, Outcomes, axes_of, outcomes_of
from verefine_viz.report.run_results import stage_times


@dataclass(frozen=True, eq=False)
class RecallCurve:
    """Recall over ``run_results.THRESHOLDS``."""

    recall: Float
    band: tuple[Float, Float] | None
    """Its 95 % interval."""


@dataclass(frozen=True, eq=False)
class Line:
    """One group in numbers. None = unknown."""

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
    lifted: Spread | None
    """Share of answers by which a simulated grasp succeeds, where that was tried."""
    curve: RecallCurve | None
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
    """Compares groups, each as a whole."""
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
        lifted=drawn.mean(mine.cells(mine.lifted)),
        curve=RecallCurve(hits.sum(axis=(0, 1)) / n, drawn.band(hits, recall.n)) if n else None,
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
