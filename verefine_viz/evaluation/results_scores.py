"""Scores of results files on a data set's folder: the command line's and the report's way in."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from verefine_viz.core.errors import InputError, quoted
from verefine_viz.core.files import LEVELS_BELOW
from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.evaluation.bop_scores import BopScores, Report, bop_scores
from verefine_viz.evaluation.ground_truth import (
    BopGroundTruth,
    Targets,
    find_targets,
    read_targets,
    visible_targets,
)
from verefine_viz.evaluation.pose_table import (
    Coverage,
    Covered,
    OwnPart,
    PoseTable,
    coverage,
    missing_reason,
    own_part,
    read_pose_table,
)
from verefine_viz.scenes.annotations import Task, targets_path
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.results_csv import HEADER


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores, and what they were measured on."""

    dataset: str
    split: str
    targets: str
    """Name of the targets file, or what was asked for without one."""
    is_official: bool
    """Whether there is one."""
    files: tuple[Path, ...]
    scores: tuple[BopScores, ...]
    """One for each file."""
    coverage: tuple[Coverage, ...]
    """Coverage of each file."""
    own: tuple[OwnPart | None, ...]
    """Part of each file that was asked for; where it is there, so are the ``own`` scores."""
    names: dict[int, str]
    """Names of the objects that occur."""
    notes: tuple[str, ...]
    """How far the scores can be compared with others."""
    seconds: float
    """That it took, from reading the first file on."""


def evaluate_files(
    files: Sequence[Path],
    dataset: Path,
    split: str = "",
    targets: Path | None = None,
    task: Task | None = None,
    workers: int = 1,
    report: Report = lambda done, total: None,
    covered_by: Callable[[Path], Covered | None] = lambda path: None,
    sensor: str = "",
) -> Evaluation:
    """Scores results files as the official scripts do.

    Args:
        files: results in BOP format.
        dataset: the data set's folder.
        split: its folder; empty = test, or the only one that begins with it.
        targets: a targets file, or its name in the data set's folder; None = the official one, or without one (and
            where the task is not detection) every instance of the split that is at least 10 % visible.
        task: None = the one that the targets were made for.
        workers: threads; the scores are the same for any number.
        report: called with the progress in images.
        covered_by: what the run that wrote a file covered; None = unknown.
        sensor: the one whose camera the poses are in, where scenes have several; empty = the first one.

    Raises:
        InputError: a results file breaks the format (the line is named) or has nothing about any target, or the data
            set lacks something.
        SettingsError: the task does not go with the targets.
    """
    started = time.perf_counter()
    tables = [_read(path) for path in files]
    folder = BopDataset(dataset, split or _default_split(dataset), sensor=sensor)
    truth = BopGroundTruth(folder)
    asked = _targets(folder, targets, task, truth)
    covered = tuple(coverage(table, asked) for table in tables)
    for path, table, part in zip(files, tables, covered, strict=True):
        if not part.images:
            raise InputError(
                f"{path} has no estimate for any target of {asked.name}: {missing_reason(table, asked)}; "
                "does it belong to another data set, --split or --targets?"
            )
    own = tuple(own_part(table, asked, covered_by(path)) for path, table in zip(files, tables, strict=True))
    scores = bop_scores(_with_own_names(tables, files), truth, asked, task, workers, report, own)
    for path, score in zip(files, scores, strict=True):
        if score.counts.targets and not score.counts.answered:
            raise InputError(
                f"{path} has an estimate for none of the {score.counts.targets} instances that {asked.name} asks for; "
                "does it belong to another data set, --split or --targets?"
            )
    obj_ids = {i for s in scores for i in (*s.recalls_by_object, *s.precision_by_object)}
    return Evaluation(
        folder.name,
        folder.split,
        asked.name,
        asked.is_official,
        tuple(files),
        scores,
        covered,
        own,
        {i: folder.models.name(i) for i in sorted(obj_ids)},
        (
            *_targets_file_fault(asked, folder),
            *folder.sensor_notes(sorted({scene_id for scene_id, _ in asked.counts})),
            *(note for table in tables for note in table.notes),
            *truth.notes,
            *_unknown_instances(asked, scores[0]),
        ),
        time.perf_counter() - started,
    )


def _default_split(dataset: Path) -> str:
    """``test``, or the data set's only folder that begins with it.

    Raises:
        InputError: the folder is not there, or it is not clear which split is meant.
    """
    if not dataset.is_dir():
        wrong = "is a file, not a folder" if dataset.exists() else "does not exist"
        raise InputError(f"data set folder {dataset} {wrong}; give --dataset a folder in BOP layout")
    if (dataset / "test").is_dir():
        return "test"
    splits = sorted(p.name for p in dataset.glob("test*") if p.is_dir())
    if len(splits) != 1:
        there = ", ".join(splits) if splits else "no folder test*"
        raise InputError(f"{dataset} has {there}; name one with --split")
    return splits[0]


def _targets(dataset: BopDataset, path: Path | None, task: Task | None, truth: BopGroundTruth) -> Targets:
    if path is None:
        return _default_targets(dataset, truth, task)
    inside = dataset.folder / path
    if not os.path.lexists(path) and not os.path.lexists(inside):
        raise InputError(f"targets file {quoted(str(path), 200)} does not exist, neither here nor in {dataset.folder}")
    return read_targets(path if os.path.lexists(path) else inside)


def _default_targets(dataset: BopDataset, truth: BopGroundTruth, task: Task | None = None) -> Targets:
    """What the data set asks for; without a targets file every instance of the split that is 10 % visible.

    Raises:
        InputError: its targets file is damaged, or missing where it is needed; or there is no ground truth.
    """
    if task == "detection" or targets_path(dataset.folder, dataset.split, task) is not None:
        return read_targets(find_targets(dataset.folder, dataset.split, task))
    images = truth.images()
    if not images:
        raise InputError(f"no image of {dataset.folder / dataset.split} has ground truth; without it nothing is scored")
    return visible_targets(truth, images)


def _targets_file_fault(asked: Targets, dataset: BopDataset) -> tuple[str, ...]:
    if asked.is_official:
        return ()
    return (
        f"{dataset.folder} has no targets file for {dataset.split}, so all instances of its scene_gt.json that are at "
        "least 10 % visible were asked for, as BOP chooses them",
    )


def _unknown_instances(asked: Targets, score: BopScores) -> tuple[str, ...]:
    """A note where instances are asked for that ground truth does not hold."""
    n_asked = sum(n for counts in asked.counts.values() for n in counts.values())
    if score.task == "detection" or n_asked <= score.counts.targets:
        return ()
    return (
        f"{asked.name} asks for {n_asked} instances, of which ground truth holds {score.counts.targets}; "
        "the others do not count, as in the official score",
    )


def _read(path: Path) -> PoseTable:
    if path.is_dir():
        raise InputError(f"{path} is a folder, expected a BOP results CSV{_inside(path)}")
    try:
        return read_pose_table(path)
    except InputError as error:
        if path.suffix.lower() == ".csv" or not path.is_file():
            raise
        raise InputError(
            f"{path} is no results file; expected a BOP results CSV ({HEADER}), such as a batch's results.csv: {error}"
        ) from None


def _inside(folder: Path) -> str:
    """A hint at the results files in a folder that was named for one."""
    inside = [p for depth in range(LEVELS_BELOW + 1) for p in sorted(folder.glob("*/" * depth + "results.csv"))]
    if not inside:
        return ", such as a batch's results.csv"
    return f"; did you mean {first_of(inside, MOST_NAMED, ' or ')}?"


def _with_own_names(tables: Sequence[PoseTable], files: Sequence[Path]) -> list[PoseTable]:
    """Methods that share a name are called as their files are; where those share one too, as their folders are.

    A lone results.csv is called as its folder is.
    """
    names = [table.name for table in tables]
    for name, n in Counter(names).items():
        if n > 1:
            names = [path.stem if own == name else own for own, path in zip(names, files, strict=True)]
    for name, n in Counter(names).items():
        if n > 1:
            same = [k for k, own in enumerate(names) if own == name]
            for k, folder in zip(same, _tails([files[k].absolute().parent for k in same]), strict=True):
                names[k] = folder
    for k, path in enumerate(files):
        # Every batch calls its answers so.
        if names[k] == path.stem == "results" and path.absolute().parent.name not in ("", *names):
            names[k] = path.absolute().parent.name
    return [replace(table, name=name) for table, name in zip(tables, names, strict=True)]


def _tails(folders: Sequence[Path]) -> list[str]:
    """As many of the last parts of each path as make them differ: ``rir-0``, or ``a/out`` and ``b/out``."""
    longest = max(len(folder.parts) for folder in folders)
    for n in range(1, longest):
        tails = ["/".join(folder.parts[-n:]) for folder in folders]
        if len(set(tails)) == len(set(folders)):
            return tails
    return [str(folder) for folder in folders]
