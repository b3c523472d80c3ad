"""A run as a report sees it: its rows, failures, answers and recordings; and its headline numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from verefine_viz.batch.index import BatchIndex, read_batch
from verefine_viz.batch.motion_table import Track, read_tracks
from verefine_viz.batch.runs import Runs, file_stem
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.methods.registry import method_of
from verefine_viz.run.answers import solving_s
from verefine_viz.run.record import Answer

Key = tuple[int, int, int | None, int | None]
"""scene_id, im_id, instance_id, obj_id: the same object in two runs."""


@dataclass(frozen=True, eq=False)
class LoadedRun:
    """One run."""

    label: str
    """"A" or "B" beside another run; empty where it stands alone."""
    index: BatchIndex

    @property
    def folder(self) -> Path:
        return self.index.folder

    @property
    def rows(self) -> tuple[Answer, ...]:
        """One per object; one per failed frame whose objects are unknown."""
        return self.index.rows

    @property
    def method(self) -> str:
        return self.index.session.method.name

    @property
    def name(self) -> str:
        """For legends and headings."""
        return f"{self.label}: {self.method} ({self.folder.name})" if self.label else self.method

    @cached_property
    def frames(self) -> tuple[str, ...]:
        """Each "scene/image", in the order of frames.csv."""
        return tuple(dict.fromkeys(row.frame for row in self.rows))

    @cached_property
    def objects(self) -> tuple[Answer, ...]:
        """Rows of objects, also of those that were left out or are in failed frames: they are missed."""
        return tuple(row for row in self.rows if row.is_object)

    @cached_property
    def with_truth(self) -> tuple[Answer, ...]:
        """Objects that can be right or wrong."""
        return tuple(row for row in self.objects if row.can_be_right)

    @cached_property
    def failures(self) -> tuple[Answer, ...]:
        """Objects whose answer is wrong or missing, worst first; without any ground truth all objects, by score.

        Only those that were asked for: what is left out or in a failed frame is no failure of the method.
        """
        worst_first = [row for row in self.index.sorted_by("error") if row.was_asked_for]
        if not self.with_truth:
            return tuple(worst_first)
        return tuple(row for row in worst_first if row.status == "no_answer" or row.is_correct is False)

    @cached_property
    def _by_key(self) -> dict[Key, Answer]:
        return {key(row): row for row in self.objects}

    def row_of(self, other: Answer) -> Answer | None:
        """The same object as another run's row; None where this run does not have it."""
        return self._by_key.get(key(other))

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """The objects over the frames of a sequence; none where the run is of single frames."""
        return read_tracks(self.folder)

    @property
    def runs(self) -> Runs:
        """The run file of each frame."""
        return Runs(self.folder / "runs")

    @cached_property
    def solving_ms(self) -> float | None:
        """Mean of the times that results.csv states for images with an answer [ms]; None where there are none."""
        ends = [record.end for record in self.runs.records(self.frames) if record.end is not None]
        times_s = [solving_s(end) for end in ends if any(a.T_cam_obj is not None for a in end.answers)]
        return 1e3 * sum(times_s) / len(times_s) if times_s else None

    def recording(self, frame: str) -> Path:
        """Where the frame's recording is, if it has one."""
        return self.folder / "recordings" / f"{file_stem(frame)}.rrd"


def load(folder: Path, label: str = "") -> LoadedRun:
    """The run in ``folder``.

    Raises:
        InputError: it is no batch folder, its files are missing or damaged, or it holds no result.
    """
    loaded = LoadedRun(label, read_batch(folder))
    if not loaded.rows:
        raise InputError(f"{folder} holds a run without a single finished frame; run verefine-viz batch again")
    return loaded


def load_pair(folder: Path, other: Path) -> tuple[LoadedRun, LoadedRun]:
    """Two runs that can be compared.

    Raises:
        InputError: one of them cannot be read, or they are not about the same objects of the same data set.
    """
    a, b = load(folder, "A"), load(other, "B")
    if folder.resolve() == other.resolve():
        raise InputError(f"{folder} and {other} are the same folder; name two runs, or one")
    check_same_data((a, b))
    if not {key(row) for row in a.objects} & {key(row) for row in b.objects}:
        raise InputError(f"{folder} and {other} have no object in common: they are about other frames or other objects")
    return a, b


def check_same_data(runs: Sequence[LoadedRun]) -> None:
    """
    Raises:
        InputError: the runs are about different data sets.
    """
    first = runs[0]
    for run in runs:
        if data_set(run) != data_set(first):
            raise InputError(
                f"{first.folder} is a run on {data_set(first)} and {run.folder} one on {data_set(run)}; "
                "only runs on the same data compare"
            )


def data_set(run: LoadedRun) -> str:
    """Which data a run is about, in words."""
    scene = run.index.session.scene
    if scene.source == "demo":
        return f"the built-in scene {scene.demo}"
    return f"{Path(scene.dataset).name}/{scene.split}" if scene.source == "bop" else Path(scene.dataset).name


def key(row: Answer) -> Key:
    """What makes two rows be about the same object."""
    return row.scene_id, row.im_id, row.instance_id, row.obj_id


def error_or_infinite(row: Answer) -> float:
    """ADD(-S) of the answer as a share of the diameter; infinite where there is no answer or no ground truth."""
    return math.inf if row.relative_error is None else row.relative_error


THRESHOLDS = np.linspace(0.0, 0.5, 101)
"""Of the recall curve: ADD(-S) as a share of the diameter."""


@dataclass(frozen=True)
class Numbers:
    """Of some objects. None = unknown."""

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


def numbers_of(run: LoadedRun, ar: float | None = None) -> Numbers:
    """Of the whole run."""
    return _numbers(run.rows, run.method, ar, run.solving_ms)


def by_object(run: LoadedRun, ar: dict[int, float]) -> tuple[ObjectNumbers, ...]:
    """Of each object model, by id."""
    groups: dict[int, list[Answer]] = {}
    for row in run.objects:
        if row.obj_id is not None:
            groups.setdefault(row.obj_id, []).append(row)
    return tuple(
        ObjectNumbers(obj_id, rows[0].name, _numbers(rows, run.method, ar.get(obj_id)), _most_frequent(rows))
        for obj_id, rows in sorted(groups.items())
    )


def recall_curve(rows: Iterable[Answer]) -> Float:
    """Recall at each of :data:`THRESHOLDS` over rows with ground truth; no answer is right at no threshold."""
    errors = np.array([error_or_infinite(row) for row in rows])
    return (errors[:, None] < THRESHOLDS).mean(axis=0) if len(errors) else np.full(len(THRESHOLDS), np.nan)


def stage_times(run: LoadedRun) -> dict[str, float]:
    """Mean milliseconds a frame by stage, in the order of a frame's life; empty where nothing is known.

    The iterations are split up into the parts that the rows have: refining, simulating, scoring.
    """
    n = len({row.frame for row in run.rows if row.status != "failed"})
    if not n:
        return {}
    stages: dict[str, float] = dict(run.index.run.totals.mean_stages_ms_per_frame)
    parts = {
        "refine": sum(row.ms_refine for row in run.objects) / n,
        "simulate": sum(row.ms_simulate for row in run.objects) / n,
        "score": sum(row.ms_score for row in run.objects) / n,
    }
    rest = stages.pop("iterate", sum(row.ms_total for row in run.objects) / n) - sum(parts.values())
    first = {name: stages.pop(name) for name in ("read", "prepare", "start") if name in stages}
    return {**first, **parts, "rest of the iterations": max(rest, 0.0), **stages}


def _numbers(rows: Sequence[Answer], method: str, ar: float | None, solving_ms: float | None = None) -> Numbers:
    objects = [row for row in rows if row.is_object]
    solved = [row for row in objects if row.status == "ok"]
    with_truth = [row for row in objects if row.can_be_right]
    errors = [row.add_s_mm for row in solved if row.add_s_mm is not None]
    scores = [row.score for row in solved if row.score is not None]
    return Numbers(
        n_frames=len({row.frame for row in rows}),
        n_failed_frames=len({row.frame for row in rows if row.status == "failed"}),
        n_objects=len(objects),
        n_with_truth=len(with_truth),
        n_without_answer=sum(row.status == "no_answer" for row in objects),
        n_left_out=sum(row.status == "left_out" for row in objects),
        n_in_failed_frames=sum(row.status == "failed" for row in objects),
        recall=sum(row.is_correct is True for row in with_truth) / len(with_truth) if with_truth else None,
        median_mm=float(np.median(errors)) if errors else None,
        mean_mm=float(np.mean(errors)) if errors else None,
        median_score=float(np.median(scores)) if scores else None,
        solving_ms=solving_ms,
        calls_per_object=None
        if method_of(method).has_tree or not solved
        else sum(row.n_iterations for row in solved) / len(solved),
        ar=ar,
    )


def _most_frequent(rows: Sequence[Answer]) -> str:
    causes = [row.cause for row in rows if row.cause]
    return max(sorted(set(causes)), key=causes.count) if causes else ""
