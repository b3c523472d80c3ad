"""BOP scores of a run on the frames that it solved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from verefine_viz.batch.completeness import result_rows
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.evaluation.averages import Recalls
from verefine_viz.evaluation.bop_scores import bop_scores
from verefine_viz.evaluation.ground_truth import (
    BopTruth,
    ProblemTruth,
    Targets,
    TruthSource,
    find_targets,
    read_targets,
    visible_targets,
)
from verefine_viz.evaluation.pose_table import pose_table
from verefine_viz.report.run_results import Loaded
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.frames import parse_frame
from verefine_viz.scenes.results_csv import ResultRow
from verefine_viz.scenes.source import open_scene


@dataclass(frozen=True, eq=False)
class BopRecalls:
    """Average recalls, or why there are none."""

    total: Recalls | None = None
    by_object: dict[int, Recalls] = field(default_factory=dict)
    note: str = ""
    """What was asked for; or, without recalls, what is missing for them."""

    @property
    def ar(self) -> float | None:
        return None if self.total is None else self.total.ar

    @property
    def ar_by_object(self) -> dict[int, float]:
        return {obj_id: recalls.ar for obj_id, recalls in self.by_object.items()}


def bop_recalls(run: Loaded, workers: int = 1, tell: Callable[[int, int], None] = lambda done, of: None) -> BopRecalls:
    """The recalls of a run over what is asked for in its frames: the targets file's entries, else what is visible.

    A run whose data set cannot be read, or without ground truth, has none; that is no error.
    """
    if not run.with_truth:
        return BopRecalls(note="BOP scores need ground truth, which this data does not have.")
    try:
        truth, targets = asked(run, run.frames)
        table = pose_table(run.method, list(run_rows(run, run.frames)))
        scores = bop_scores([table], truth, targets, "localization", workers, tell)
    except VerefineError as error:
        return BopRecalls(note=f"No BOP scores: {error}.")
    found = scores[0]
    return BopRecalls(found.recalls, found.recalls_by_object, measured_on(truth, targets))


def measured_on(truth: TruthSource, targets: Targets) -> str:
    """What was asked for, and what a person should know about the data that scores were measured on."""
    notes = (f" {note[:1].upper()}{note[1:]}." for note in truth.notes)
    return f"BOP scores over {targets.name}." + "".join(notes)


def asked(run: Loaded, frames: Sequence[str]) -> tuple[TruthSource, Targets]:
    """The ground truth of a run's data, and what is asked for in each of ``frames``: nothing, where nothing is seen.

    Raises:
        VerefineError: the data cannot be read.
    """
    scene = run.index.session.scene.model_copy(update={"frames": tuple(frames)})
    images = [parse_frame(frame) for frame in frames]
    if scene.source == "demo":
        source = open_scene(scene, run.index.session.hypotheses)
        truth = ProblemTruth(scene.demo, [source.problem(frame) for frame in frames])
        return truth, truth.targets
    dataset = BopDataset(Path(scene.dataset), scene.split)
    truth = BopTruth(dataset)
    try:
        listed = read_targets(find_targets(dataset.folder, dataset.split, "localization"))
        if listed.task != "localization":
            raise InputError("the targets file is not about localization")
        counts, name = {i: dict(listed.counts[i]) for i in images if i in listed.counts}, listed.name
    except InputError:
        counts, name = {}, ""
    if len(counts) < len(images):
        listed = visible_targets(truth, images)
        counts, name = {i: dict(mine) for i, mine in listed.counts.items()}, listed.name
    if scene.objects:
        counts = {image: {i: n for i, n in mine.items() if i in scene.objects} for image, mine in counts.items()}
    return truth, Targets(f"{name} in these frames", counts, "localization")


def run_rows(run: Loaded, frames: Sequence[str]) -> Iterator[ResultRow]:
    """The answers of a run in ``frames``, as results.csv has them.

    Raises:
        InputError: the journal's entry of a frame is gone or damaged.
    """
    for frame in frames:
        result = run.journal.entry(frame)
        if result is None:
            raise InputError(
                f"{run.journal.folder} says nothing about frame {frame}; the same batch command solves it again"
            )
        yield from result_rows(result)
