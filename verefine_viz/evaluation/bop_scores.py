"""BOP scores of results: average recall (BOP'19 localization) or average precision (BOP'24 detection).

One pass over the images serves any number of methods: a depth image is read once, ground truth is drawn once, an
estimate is drawn once and all of its errors go into one table, from which every threshold is counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import SettingsError
from verefine_viz.evaluation.averages import (
    DETECTION_THRESHOLDS,
    IGNORED,
    RIGHT,
    THRESHOLDS,
    WRONG,
    Detections,
    Precision,
    Recalls,
    Tally,
)
from verefine_viz.evaluation.ground_truth import VISIB_FRACT, GtInstance, GtSource, Targets
from verefine_viz.evaluation.matched_estimates import AskedInstance, answers, match_thresholds
from verefine_viz.evaluation.pair_errors import DrawnTruth, pair_errors
from verefine_viz.evaluation.pose_table import Image, OwnPart, PoseTable
from verefine_viz.evaluation.vertex_errors import adi_by_index_mm, adi_mm
from verefine_viz.evaluation.vsd import DELTA_MM, DELTA_MM_ITODD
from verefine_viz.scenes.annotations import Task

MAX_PER_IMAGE = {"xyzibd": 200}
"""Detection: most estimates of an image that count, the best ones; 100 for all other data sets."""

INDEX_FROM = 32
"""Number of estimates of an object from which an index for ADI saves time."""

Report = Callable[[int, int], None]
"""Called with how many images are done, and how many there are."""


@dataclass(frozen=True)
class RowCounts:
    """How many rows of a results file were scored, and how many instances have one."""

    rows: int
    scored: int
    """Rows that were compared with ground truth."""
    surplus: int
    """Rows beyond the number of instances asked for (or beyond the limit of an image), the lowest scores."""
    unasked: int
    """Rows about scenes, images or objects that are no targets; the benchmark ignores them."""
    targets: int
    """Instances asked for."""
    missing: int
    """Instances asked for that have no row."""

    @property
    def answered(self) -> int:
        """Instances asked for that have a row, however wrong its pose."""
        return self.targets - self.missing


@dataclass(frozen=True, eq=False)
class BopScores:
    """Scores of one method on one data set: ``recalls`` for localization, ``precision`` for detection."""

    name: str
    task: Task
    counts: RowCounts
    mean_time_s: float
    """Mean time per image [s]; -1 = unknown."""
    recalls: Recalls | None
    recalls_by_object: dict[int, Recalls]
    recalls_by_scene: dict[int, Recalls]
    precision: Precision | None
    precision_by_object: dict[int, Precision]
    answers: tuple[AskedInstance, ...]
    """Localization: one entry per instance asked for, images in the order of the targets."""
    own: BopScores | None = None
    """Scores over the table's own part, as if nothing else were asked for; None where there is no such part."""


def bop_scores(
    tables: Sequence[PoseTable],
    ground_truth: GtSource,
    targets: Targets,
    task: Task | None = None,
    workers: int = 1,
    report: Report = lambda done, total: None,
    own_parts: Sequence[OwnPart | None] = (),
) -> tuple[BopScores, ...]:
    """The scores of each table, as the official scripts compute them for its results file.

    Args:
        tables: one per method.
        ground_truth: of a data set or of problems in memory.
        targets: what is asked for.
        task: by default the one that the targets were made for.
        workers: threads; the scores are the same for any number.
        report: called with the progress.
        own_parts: for each table the part of the targets that it is about, where a score over this alone is wanted
            as well.

    Raises:
        InputError: the targets name what the data set does not have, or one of its files is damaged.
        SettingsError: localization is asked for, but the targets do not list how many instances there are.
    """
    task = targets.task if task is None else task
    if task == "localization" and targets.task == "detection":
        raise SettingsError(
            f"{targets.name} says nothing about objects, which is enough for the task detection only; "
            "name a …_targets_bop19.json with --targets"
        )
    images = list(targets.counts)
    # Before threads start: models are read once, and a missing one ends it at once.
    asked = {obj_id for counts in targets.counts.values() for obj_id in counts}
    for obj_id in sorted({i for table in tables for mine in table.by_image.values() for i in mine} & asked):
        ground_truth.model(obj_id)
    kind = _Localization if task == "localization" else _Detection
    score, own_score = kind(tables, ground_truth, targets), kind(tables, ground_truth, targets)
    own_parts = own_parts or [None] * len(tables)
    pool = ThreadPoolExecutor(workers)
    try:
        for done, (image, parts) in enumerate(zip(images, pool.map(score.image, images), strict=True), start=1):
            score.add(image, parts)
            both = zip(parts, own_parts, strict=True)
            own_score.add(image, [[p for p in mine if own and own.holds(image, p.obj_id)] for mine, own in both])
            report(done, len(images))
    finally:
        # After an error or Ctrl-C the images that have not begun are dropped.
        pool.shutdown(cancel_futures=True)
    return tuple(
        replace(scores, own=own if part else None)
        for scores, own, part in zip(score.scores(), own_score.scores(), own_parts, strict=True)
    )


@dataclass(frozen=True, eq=False)
class _ImageObject:
    """One object of one image, of one method."""

    obj_id: int
    n_targets: int
    n_rows: int
    rows: tuple[int, ...]
    """Rows that are scored, by descending score."""
    matched: np.ndarray
    """Localization: (12, 10) instances matched. Detection: (3, 10, E) outcomes."""
    answers: tuple[AskedInstance, ...] = ()


class _Localization:
    def __init__(self, tables: Sequence[PoseTable], ground_truth: GtSource, targets: Targets) -> None:
        self._tables, self._ground_truth, self._targets = tables, ground_truth, targets
        n_rows = Counter(obj_id for table in tables for _, _, obj_id in table.ids)
        self._often = {obj_id for obj_id, n in n_rows.items() if n >= INDEX_FROM}
        self._delta_mm = DELTA_MM_ITODD if ground_truth.name == "itodd" else DELTA_MM
        self._tallies = [Tally() for _ in tables]
        self._answers: list[list[AskedInstance]] = [[] for _ in tables]
        self._counts = [RowCounts(len(table), 0, 0, len(table), 0, 0) for table in tables]

    def image(self, image: Image) -> list[list[_ImageObject]]:
        """The parts of one image for each table; runs in any thread."""
        wanted = self._targets.counts[image]
        mine = [table.by_image.get(image, {}) for table in self._tables]
        with_depth = any(obj_id in rows for rows in mine for obj_id in wanted)
        drawn = DrawnTruth(self._ground_truth.image(*image, with_depth))
        return [[self._part(drawn, table, image, *target) for target in wanted.items()] for table in self._tables]

    def _part(self, drawn: DrawnTruth, table: PoseTable, image: Image, obj_id: int, count: int) -> _ImageObject:
        instances = [gt for gt in drawn.image.instances if gt.obj_id == obj_id]
        valid = _most_visible(instances, count)
        there = table.by_image.get(image, {}).get(obj_id, ())
        rows = table.best_first(there)[:count]
        matched = np.zeros(THRESHOLDS.shape, np.int64)
        if not rows or not instances:
            given = answers(None, table, image, rows, instances, valid, None)
            return _ImageObject(obj_id, int(valid.sum()), len(there), tuple(rows), matched, given)
        model = self._ground_truth.model(obj_id)
        with np.errstate(all="ignore"):
            errors = pair_errors(drawn, model, [(table.R[r], table.t_mm[r]) for r in rows], instances, self._delta_mm)
            matched = (match_thresholds(errors.kinds, THRESHOLDS, valid) >= 0).sum(axis=2)
            adi = adi_by_index_mm if obj_id in self._often else adi_mm
            given = answers(model, table, image, rows, instances, valid, errors, adi)
        return _ImageObject(obj_id, int(valid.sum()), len(there), tuple(rows), matched, given)

    def add(self, image: Image, parts: list[list[_ImageObject]]) -> None:
        for k, of_table in enumerate(parts):
            for part in of_table:
                self._tallies[k].add(image[0], part.obj_id, part.n_targets, part.matched)
                self._answers[k] += part.answers
                self._counts[k] = _counted(self._counts[k], part)

    def scores(self) -> tuple[BopScores, ...]:
        return tuple(
            BopScores(
                table.name,
                "localization",
                counts,
                table.mean_time_s,
                tally.recalls(),
                {i: tally.recalls(obj_id=i) for i in tally.obj_ids},
                {i: tally.recalls(scene_id=i) for i in tally.scene_ids},
                None,
                {},
                tuple(given),
            )
            for table, tally, counts, given in zip(
                self._tables, self._tallies, self._counts, self._answers, strict=True
            )
        )


class _Detection:
    def __init__(self, tables: Sequence[PoseTable], ground_truth: GtSource, targets: Targets) -> None:
        self._tables, self._ground_truth = tables, ground_truth
        self._limit = MAX_PER_IMAGE.get(ground_truth.name, 100)
        self._detections = [Detections() for _ in tables]
        self._counts = [RowCounts(len(table), 0, 0, len(table), 0, 0) for table in tables]

    def image(self, image: Image) -> list[list[_ImageObject]]:
        """The parts of one image for each table; runs in any thread."""
        drawn = DrawnTruth(self._ground_truth.image(*image, with_depth=False))
        return [self._parts(drawn, table, table.by_image.get(image, {})) for table in self._tables]

    def _parts(self, drawn: DrawnTruth, table: PoseTable, there: Mapping[int, Sequence[int]]) -> list[_ImageObject]:
        best = set(table.best_first(sorted(row for rows in there.values() for row in rows))[: self._limit])
        # Estimates of objects that are not in the image do not count, as in the official script.
        obj_ids = dict.fromkeys(gt.obj_id for gt in drawn.image.instances)
        return [self._part(drawn, table, i, there.get(i, []), best) for i in obj_ids]

    def _part(
        self, drawn: DrawnTruth, table: PoseTable, obj_id: int, there: Sequence[int], best: set[int]
    ) -> _ImageObject:
        instances = [gt for gt in drawn.image.instances if gt.obj_id == obj_id]
        visible = np.array([gt.visib_fract >= VISIB_FRACT for gt in instances])
        # The official script sorts an image's rows before it cuts them; equal scores then are in the same order.
        rows = table.best_first(row for row in there if row in best)
        outcomes = np.zeros((*DETECTION_THRESHOLDS.shape, 0), np.int64)
        if rows:
            with np.errstate(all="ignore"):
                poses = [(table.R[r], table.t_mm[r]) for r in rows]
                errors = pair_errors(drawn, self._ground_truth.model(obj_id), poses, instances, DELTA_MM)
                kinds = np.stack([errors.mssd_mm / errors.diameter_mm, errors.mssd_mm, errors.mspd_px])
                matched = match_thresholds(kinds, DETECTION_THRESHOLDS, np.ones(len(instances), np.bool_))
            outcomes = np.where(matched < 0, WRONG, np.where(visible[matched], RIGHT, IGNORED))
        return _ImageObject(obj_id, int(visible.sum()), len(there), tuple(rows), outcomes)

    def add(self, image: Image, parts: list[list[_ImageObject]]) -> None:
        for k, of_table in enumerate(parts):
            for part in of_table:
                scores: Float = self._tables[k].scores[list(part.rows)]
                self._detections[k].add(part.obj_id, part.n_targets, scores, part.matched)
                self._counts[k] = _counted(self._counts[k], part)

    def scores(self) -> tuple[BopScores, ...]:
        return tuple(
            BopScores(
                table.name,
                "detection",
                counts,
                table.mean_time_s,
                None,
                {},
                {},
                detections.summary(),
                {i: detections.summary(i) for i in detections.obj_ids},
                (),
            )
            for table, detections, counts in zip(self._tables, self._detections, self._counts, strict=True)
        )


def _most_visible(instances: Sequence[GtInstance], count: int) -> np.ndarray:
    """(G,) whether each of an object's instances is one of the ``count`` most visible ones; ties go to the first."""
    order = sorted(range(len(instances)), key=lambda g: instances[g].visib_fract, reverse=True)
    valid = np.zeros(len(instances), np.bool_)
    valid[order[:count]] = True
    return valid


def _counted(so_far: RowCounts, part: _ImageObject) -> RowCounts:
    return RowCounts(
        so_far.rows,
        so_far.scored + len(part.rows),
        so_far.surplus + part.n_rows - len(part.rows),
        so_far.unasked - part.n_rows,
        so_far.targets + part.n_targets,
        so_far.missing + max(part.n_targets - len(part.rows), 0),
    )
