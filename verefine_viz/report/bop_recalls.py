"""BOP scores of runs on the frames that they solved: of a whole run, or frame by frame of many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from verefine_viz.batch.completeness import result_rows
from verefine_viz.core.errors import InputError, VerefineError
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
from verefine_viz.report.bootstrap import Cells
from verefine_viz.report.groups import Progress, seeds_of
from verefine_viz.report.object_results import Axes
from verefine_viz.report.run_results import LoadedRun
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.frames import parse_frame
from verefine_viz.scenes.results_csv import ResultRow
from verefine_viz.scenes.source import open_scene

NO_GROUND_TRUTH = "BOP scores need ground truth, which this data does not have."


@dataclass(frozen=True, eq=False)
class BopRecalls:
    """Average recalls of a run, or why there are none."""

    ar: float | None = None
    ar_by_object: dict[int, float] = field(default_factory=dict)
    note: str = ""
    """What was asked for; or, without recalls, what is missing for them."""


def bop_recalls(run: LoadedRun, workers: int = 1, progress: Progress = lambda done, of: None) -> BopRecalls:
    """The recalls of a run over what is asked for in its frames: the targets file's entries, else what is visible.

    A run whose data set cannot be read, or without ground truth, has none; that is no error.
    """
    if not run.with_truth:
        return BopRecalls(note=NO_GROUND_TRUTH)
    try:
        ground_truth, targets = _asked(run, run.frames)
        table = pose_table(run.method, list(run_rows(run, run.frames)))
        scores = bop_scores([table], ground_truth, targets, "localization", workers, progress)
    except VerefineError as error:
        return BopRecalls(note=f"No BOP scores: {error}.")
    recalls, by_object = scores[0].recalls, scores[0].recalls_by_object
    return BopRecalls(
        None if recalls is None else recalls.ar,
        {obj_id: of_object.ar for obj_id, of_object in by_object.items()},
        _measured_on(ground_truth, targets),
    )


@dataclass(frozen=True, eq=False)
class FrameRecalls:
    """Average recall of each frame of several runs, or why there is none."""

    by_frame: dict[tuple[Path, str], tuple[int, float]] = field(default_factory=dict)
    """Folder of the run and frame → instances asked for, AR over them."""
    note: str = ""
    """What was asked for; or, without recalls, what is missing for them."""

    def cells(self, runs: Sequence[LoadedRun], axes: Axes) -> Cells | None:
        """AR by frame and seed of some runs; None where nothing was asked for."""
        total, n = np.zeros(axes.shape), np.zeros(axes.shape)
        for run in runs:
            for frame in run.frames:
                n_targets, ar = self.by_frame.get((run.folder, frame), (0, 0.0))
                cell = axes.unit_of[frame], axes.seed_of[seeds_of(run)]
                total[cell] += n_targets * ar
                n[cell] += n_targets
        return Cells(total, n) if n.any() else None


def frame_recalls(
    runs: Sequence[LoadedRun], workers: int = 1, progress: Progress = lambda done, of: None
) -> FrameRecalls:
    """The average recall of each frame in each run; images are read, and ground truth is drawn, once for all runs.

    Runs are asked for what the first one was about, in the frames that they have.
    """
    if not any(run.with_truth for run in runs):
        return FrameRecalls(note=NO_GROUND_TRUTH)
    having: dict[str, list[LoadedRun]] = {}
    for run in runs:
        for frame in run.frames:
            having.setdefault(frame, []).append(run)
    by_frame: dict[tuple[Path, str], tuple[int, float]] = {}
    try:
        ground_truth, targets = _asked(runs[0], tuple(having))
        # Threads share the models: they are read before.
        for obj_id in sorted({i for counts in targets.counts.values() for i in counts}):
            ground_truth.model(obj_id)

        def solve(frame: str) -> dict[tuple[Path, str], tuple[int, float]]:
            image = parse_frame(frame)
            tables = [pose_table(run.method, list(run_rows(run, (frame,)))) for run in having[frame]]
            alone = Targets(targets.name, {image: targets.counts[image]}, targets.task)
            recalls = [scores.recalls for scores in bop_scores(tables, ground_truth, alone, "localization")]
            return {
                (run.folder, frame): (r.n_targets, r.ar) for run, r in zip(having[frame], recalls, strict=True) if r
            }

        with ThreadPoolExecutor(workers) as pool:
            for done, of_frame in enumerate(pool.map(solve, having), start=1):
                by_frame |= of_frame
                progress(done, len(having))
    except VerefineError as error:
        return FrameRecalls(note=f"No BOP scores: {error}.")
    return FrameRecalls(by_frame, _measured_on(ground_truth, targets))


def _measured_on(ground_truth: GtSource, targets: Targets) -> str:
    """What was asked for, and what to know about the data that scores were measured on."""
    notes = (f" {note[:1].upper()}{note[1:]}." for note in ground_truth.notes)
    return f"BOP scores over {targets.name}." + "".join(notes)


def _asked(run: LoadedRun, frames: Sequence[str]) -> tuple[GtSource, Targets]:
    """The ground truth of a run's data, and what is asked for in each of ``frames``: nothing, where nothing is visible.

    Raises:
        VerefineError: the data cannot be read.
    """
    scene = run.index.session.scene.model_copy(update={"frames": tuple(frames)})
    images = [parse_frame(frame) for frame in frames]
    if scene.source != "bop":
        source = open_scene(scene, run.index.session.hypotheses)
        built_in = ProblemGroundTruth(
            scene.demo if scene.source == "demo" else Path(scene.dataset).name,
            [source.problem(frame) for frame in frames],
        )
        return built_in, built_in.targets
    dataset = BopDataset(Path(scene.dataset), scene.split)
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


def run_rows(run: LoadedRun, frames: Sequence[str]) -> Iterator[ResultRow]:
    """The answers of a run in ``frames``, as results.csv has them.

    Raises:
        InputError: the run file of a frame is gone or damaged.
    """
    for frame in frames:
        record = run.runs.entry(frame)
        if record is None:
            raise InputError(
                f"{run.runs.folder} says nothing about frame {frame}; the same batch command solves it again"
            )
        yield from result_rows(record)
