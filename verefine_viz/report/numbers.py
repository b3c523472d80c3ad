"""What a run comes to in numbers: the headline, and a row for each object."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.batch.misled import misled
from verefine_viz.batch.rows import ObjectRow
from verefine_viz.core.arrays import Float
from verefine_viz.methods.registry import method_of
from verefine_viz.report.loaded import Loaded, error_or_infinite

THRESHOLDS = np.linspace(0.0, 0.5, 101)
"""Of the recall curve: ADD(-S) as a share of the diameter."""


@dataclass(frozen=True)
class Numbers:
    """Of some objects. None = nobody can say."""

    n_frames: int
    n_failed_frames: int
    n_objects: int
    n_with_truth: int
    n_without_answer: int
    """Without a hypothesis."""
    n_left_out: int
    """Without a mask or a model that can be used."""
    n_in_failed_frames: int
    recall: float | None
    """Share of the objects with ground truth whose ADD(-S) is below 10 % of the diameter; no answer is a miss."""
    median_mm: float | None
    """ADD(-S), over the objects that got an answer."""
    mean_mm: float | None
    median_score: float | None
    solving_ms: float | None
    """Time for first scores and iterations of a frame, mean; only of a whole run."""
    calls_per_object: float | None
    """Refiner calls; None for methods that do not call it once an iteration."""
    ar: float | None = None
    """BOP average recall."""


@dataclass(frozen=True)
class ObjectNumbers:
    """One object model over all frames."""

    obj_id: int
    name: str
    numbers: Numbers
    most_frequent_cause: str


def numbers_of(run: Loaded, ar: float | None = None) -> Numbers:
    """Of the whole run."""
    return _numbers(run.rows, run.method, ar, run.solving_ms)


def by_object(run: Loaded, ar: dict[int, float]) -> tuple[ObjectNumbers, ...]:
    """Of each object model, by id."""
    groups: dict[int, list[ObjectRow]] = {}
    for row in run.objects:
        if row.obj_id is not None:
            groups.setdefault(row.obj_id, []).append(row)
    return tuple(
        ObjectNumbers(obj_id, rows[0].name, _numbers(rows, run.method, ar.get(obj_id)), _most_frequent(rows))
        for obj_id, rows in sorted(groups.items())
    )


def recall_curve(rows: Iterable[ObjectRow]) -> Float:
    """Recall at each of :data:`THRESHOLDS` over rows with ground truth; no answer is found at no threshold."""
    errors = np.array([error_or_infinite(row) for row in rows])
    return (errors[:, None] < THRESHOLDS).mean(axis=0) if len(errors) else np.full(len(THRESHOLDS), np.nan)


def lies(run: Loaded) -> float | None:
    """How often the score misleads: the share of pairs (wrong, right answer) in which the wrong one scores higher.

    0 = the score tells them apart, ½ = it knows nothing; None where there are no such pairs.
    """
    return misled(run.objects)


def stage_times(run: Loaded) -> dict[str, float]:
    """Mean milliseconds a frame by stage, in the order of a frame's life; empty where nothing is known.

    The iterations are split up into what the rows know about: refining, simulating, scoring.
    """
    n = _n_solved_frames(run.rows)
    if not n:
        return {}
    stages: dict[str, float] = dict(run.index.run.totals.mean_stages_ms_per_frame)
    parts = {
        "refine": sum(row.ms_refine for row in run.objects) / n,
        "simulate": sum(row.ms_simulate for row in run.objects) / n,
        "score": sum(row.ms_score for row in run.objects) / n,
    }
    rest = stages.pop("iterate", sum(row.ms_total for row in run.objects) / n) - sum(parts.values())
    first = {name: stages.pop(name) for name in ("read", "start") if name in stages}
    return {**first, **parts, "rest of the iterations": max(rest, 0.0), **stages}


def _numbers(rows: Sequence[ObjectRow], method: str, ar: float | None, solving_ms: float | None = None) -> Numbers:
    objects = [row for row in rows if row.is_object]
    solved = [row for row in objects if row.status == "ok"]
    truth = [row for row in objects if row.has_truth or row.add_s_mm is not None]
    errors = [row.add_s_mm for row in solved if row.add_s_mm is not None]
    scores = [row.score for row in solved if row.score is not None]
    return Numbers(
        n_frames=len({row.frame for row in rows}),
        n_failed_frames=len({row.frame for row in rows if row.status == "failed"}),
        n_objects=len(objects),
        n_with_truth=len(truth),
        n_without_answer=sum(row.status == "no_answer" for row in objects),
        n_left_out=sum(row.status == "left_out" for row in objects),
        n_in_failed_frames=sum(row.status == "failed" for row in objects),
        recall=sum(row.is_correct is True for row in truth) / len(truth) if truth else None,
        median_mm=float(np.median(errors)) if errors else None,
        mean_mm=float(np.mean(errors)) if errors else None,
        median_score=float(np.median(scores)) if scores else None,
        solving_ms=solving_ms,
        calls_per_object=None
        if method_of(method).has_tree or not solved
        else sum(row.n_iterations for row in solved) / len(solved),
        ar=ar,
    )


def _n_solved_frames(rows: Iterable[ObjectRow]) -> int:
    return len({row.frame for row in rows if row.status != "failed"})


def _most_frequent(rows: Sequence[ObjectRow]) -> str:
    causes = [row.cause for row in rows if row.cause]
    return max(sorted(set(causes)), key=causes.count) if causes else ""
