"""BOP scores of runs on the frames that they solved, by frame and object model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import structs

from verefine_viz.batch.runs import Runs
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.evaluation.bop_scores import bop_scores
from verefine_viz.evaluation.ground_truth import (
    BopGroundTruth,
    GtSource,
    ProblemGroundTruth,
    Targets,
    find_targets,
    read_targets,
    visible_targets,
)
from verefine_viz.evaluation.pose_table import pose_table
from verefine_viz.run.answers import result_rows
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.results_csv import ResultRow
from verefine_viz.scenes.source import open_scene

if TYPE_CHECKING:
    from verefine_viz.batch.index import BatchIndex

Place = tuple[Path, str, int]
"""Folder of a run, frame, obj_id."""


@dataclass(frozen=True, eq=False)
class BopRecalls:
    """Average recall of each object model in each frame of several runs, or the reason why there is none."""

    by_place: dict[Place, tuple[int, float]] = field(default_factory=dict)
    """Number of instances asked for, and the AR over them. An AR over several of these is their mean, weighted by
    instances."""
    note: str = ""
    """A note on what was asked for or, without recalls, on what is missing for them; empty where no ground truth is
    known."""


def bop_recalls(
    runs: Sequence[BatchIndex], workers: int = 1, progress: Callable[[int, int], None] = lambda done, of: None
) -> BopRecalls:
    """The recalls of runs on the same data; images are read, and ground truth is drawn, once for all of them.

    The entries of the targets file are asked for, else the visible instances, in the frames and of the objects of the
    first run. Runs without ground truth, or whose data cannot be read, have no recalls; that is no error.
    """
    if not any(row.can_be_right for run in runs for row in run.rows):
        return BopRecalls()
    having: dict[str, list[BatchIndex]] = {}
    for run in runs:
        for frame in dict.fromkeys(row.frame for row in run.rows):
            having.setdefault(frame, []).append(run)
    by_place: dict[Place, tuple[int, float]] = {}
    try:
        ground_truth, targets = _asked(runs[0], tuple(having))
        # Threads share the models, so these are read first.
        for obj_id in sorted({i for counts in targets.counts.values() for i in counts}):
            ground_truth.model(obj_id)

        def solve(frame: str) -> dict[Place, tuple[int, float]]:
            image = parse_frame(frame)
            tables = [pose_table(run.session.method.name, list(run_rows(run, (frame,)))) for run in having[frame]]
            alone = Targets(targets.name, {image: targets.counts[image]}, targets.task)
            scores = bop_scores(tables, ground_truth, alone, "localization")
            return {
                (run.folder, frame, obj_id): (recalls.n_targets, recalls.ar)
                for run, mine in zip(having[frame], scores, strict=True)
                for obj_id, recalls in mine.recalls_by_object.items()
            }

        with ThreadPoolExecutor(workers) as pool:
            for done, of_frame in enumerate(pool.map(solve, having), start=1):
                by_place |= of_frame
                progress(done, len(having))
    except VerefineError as error:
        return BopRecalls(note=f"No BOP scores: {error}.")
    notes = (f" {note[:1].upper()}{note[1:]}." for note in ground_truth.notes)
    return BopRecalls(by_place, f"BOP scores over {targets.name}." + "".join(notes))


def _asked(run: BatchIndex, frames: Sequence[str]) -> tuple[GtSource, Targets]:
    """The ground truth of a run's data, and what is asked for in each of ``frames``: empty, where nothing is visible.

    Raises:
        VerefineError: the data cannot be read.
    """
    scene = structs.replace(run.session.scene, frames=tuple(frames))
    images = [parse_frame(frame) for frame in frames]
    if scene.source != "bop":
        source = open_scene(scene, run.session.hypotheses)
        built_in = ProblemGroundTruth(
            scene.demo if scene.source == "demo" else Path(scene.dataset).name,
            [source.problem(frame) for frame in frames],
        )
        return built_in, built_in.targets
    dataset = BopDataset(Path(scene.dataset), scene.split, sensor=scene.sensor)
    ground_truth = BopGroundTruth(dataset)
    try:
        listed = read_targets(find_targets(dataset.folder, dataset.split, "localization"))
        if listed.task != "localization":
            raise InputError("the targets file is not about localization")
        counts, name = {i: dict(listed.counts[i]) for i in images if i in listed.counts}, listed.name
    except InputError:
        counts, name = {}, ""
    if len(counts) < len(images):
        listed = visible_targets(ground_truth, images)
        counts, name = {i: dict(mine) for i, mine in listed.counts.items()}, listed.name
    if scene.objects:
        counts = {image: {i: n for i, n in mine.items() if i in scene.objects} for image, mine in counts.items()}
    return ground_truth, Targets(f"{name} in these frames", counts, "localization")


def run_rows(run: BatchIndex, frames: Sequence[str]) -> Iterator[ResultRow]:
    """The answers of a run in ``frames``, as in results.csv.

    Raises:
        InputError: the run file of a frame is gone or damaged.
    """
    runs = Runs(run.folder / "runs")
    for frame in frames:
        record = runs.entry(frame)
        if record is None:
            raise InputError(f"{runs.folder} says nothing about frame {frame}; the same batch command solves it again")
        yield from result_rows(record)
