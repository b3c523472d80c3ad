"""The numbers of groups on the same data, for comparison; all come from the table of answers and the BOP scores."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from verefine_viz.batch.totals import misranked_share
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import cause_title
from verefine_viz.evaluation.bootstrap import CellSums, Draws, Spread, draws
from verefine_viz.methods.known_methods import method_of
from verefine_viz.page.gallery_messages import BestGroup, HardObject, ObjectCell, ObjectNumbers
from verefine_viz.report.groups import Group, Section, key
from verefine_viz.run.record import Answer

if TYPE_CHECKING:
    from verefine_viz.report.bop_recalls import BopRecalls

FEWEST_SCENES = 8
"""From this many scenes on, the bootstrap draws whole scenes, whose frames look alike; otherwise frames."""
THRESHOLDS = np.linspace(0.0, 0.5, 101)
"""Thresholds of the recall curve: ADD(-S) as a share of the diameter."""
MOST_HARD = 40
"""Most objects that are listed as hard."""


@dataclass(frozen=True)
class GroupColumn:
    """A number of a group."""

    id: str
    label: str
    hint: str
    unit: str
    factor: float
    digits: int
    better: int
    """1: more is better, −1: less, 0: neither."""
    value: Callable[[Answer], float | None] = lambda row: None
    """Value of one answer; None where it is unknown. The number is its mean."""


def _solved(name: str) -> Callable[[Answer], float | None]:
    return lambda row: getattr(row, name) if row.status == "ok" else None


def _right_seen(row: Answer) -> float | None:
    """Whether an answer is right as far as the image shows; a missing one is not."""
    if not row.can_be_right or (row.status == "ok" and row.right_seen is None):
        return None
    return float(row.right_seen is True)


COLUMNS = (
    GroupColumn("recall", "right", "share of objects whose ADD(-S) is below 10 % of the diameter", "%", 100, 1, 1,
           lambda row: float(row.is_correct is True) if row.can_be_right else None),
    GroupColumn("recall_seen", "right as seen", "share of objects that are right as far as the image shows: measured "
           "from the nearest pose that it allows beside ground truth", "%", 100, 1, 1, _right_seen),
    GroupColumn("ar", "BOP AR", "average recall over VSD, MSSD and MSPD, as in the BOP challenge", "%", 100, 1, 1),
    GroupColumn("median_mm", "median ADD(-S)", "ADD, for symmetric objects ADD-S, of the objects with an answer", "mm",
           1, 1, -1),
    GroupColumn("mean_mm", "mean ADD(-S)", "of the objects with an answer", "mm", 1, 1, -1, _solved("add_s_mm")),
    GroupColumn("rotation_deg", "rotation", "mean error of the answers", "°", 1, 1, -1, lambda row: row.rotation_deg),
    GroupColumn("translation_mm", "translation", "mean error of the answers", "mm", 1, 1, -1,
           lambda row: row.translation_mm),
    GroupColumn("lifted", "lifted", "share of answers by which a simulated grasp succeeds", "%", 100, 0, 1,
           lambda row: float(row.grasp == "success") if row.grasp else None),
    GroupColumn("score", "score", "mean of the answers", "", 1, 2, 0, _solved("score")),
    GroupColumn("undetermined_mm", "undetermined", "how far answers may be shifted without the score telling, mean",
           "mm", 1, 1, 0, _solved("undetermined_mm")),
    GroupColumn("ms_per_frame", "time a frame", "computing time of the iterations for all objects of a frame, without "
           "first scores; median", "ms", 1, 0, -1),
    GroupColumn("calls", "refiner calls", "for one object, mean", "", 1, 1, 0,
           lambda row: None if row.status != "ok" or method_of(row.method).has_tree else float(row.n_iterations)),
)  # fmt: skip


class Axes:
    """The cells over which the objects of all groups are summed: frames, or whole scenes, and object models."""

    def __init__(self, groups: Sequence[Group], asked: Iterable[int] = ()) -> None:
        """``asked``: object models with BOP scores, even without an answer."""
        rows = [row for group in groups for row in group.rows]
        self.by_scene = len({row.scene_id for row in rows}) >= FEWEST_SCENES
        self._units = {unit: k for k, unit in enumerate(dict.fromkeys(self._unit(row.frame) for row in rows))}
        models = {row.obj_id or 0 for row in rows if row.is_object} | set(asked) or {0}
        self.models = {obj_id: k for k, obj_id in enumerate(sorted(models))}

    @property
    def shape(self) -> tuple[int, int]:
        return len(self._units), len(self.models)

    def unit(self, frame: str) -> int:
        """Index of a frame in the cells."""
        return self._units[self._unit(frame)]

    def place(self, row: Answer) -> tuple[int, int]:
        """Index of an object in the cells."""
        return self.unit(row.frame), self.models[row.obj_id or 0]

    def cells(self, rows: Iterable[Answer], value: Callable[[Answer], float | None]) -> CellSums:
        """Sums of a number over the objects for which it is known."""
        total, n = np.zeros(self.shape), np.zeros(self.shape)
        for row in rows:
            known = value(row)
            if known is not None:
                total[self.place(row)] += known
                n[self.place(row)] += 1
        return CellSums(total, n)

    def _unit(self, frame: str) -> str:
        return frame.partition("/")[0] if self.by_scene else frame


@dataclass(frozen=True, eq=False)
class GroupLine:
    """One group in numbers."""

    group: Group
    numbers: dict[str, Spread]
    """Values by :data:`COLUMNS`, as far as they are known."""
    behind: Spread | None
    """Difference of recall to the best group's, over the objects of both; None for the best itself."""
    curve: tuple[Float, tuple[Float, Float] | None] | None
    """Recall over :data:`THRESHOLDS`, and its 95 % interval."""
    recall: CellSums
    ar: CellSums

    @property
    def name(self) -> str:
        return self.group.name


@dataclass(frozen=True, eq=False)
class GroupComparison:
    """All groups of a section."""

    section: Section
    lines: tuple[GroupLine, ...]
    """In the order of the groups."""
    best: GroupLine
    axes: Axes

    @property
    def has_truth(self) -> bool:
        return any("recall" in line.numbers for line in self.lines)


def compare(section: Section, bop: BopRecalls) -> GroupComparison:
    """The groups of a section, each as a whole and against the best one."""
    axes = Axes(section.groups, (obj_id for _, _, obj_id in bop.by_place))
    drawn = draws(*axes.shape)
    recalls = [axes.cells(group.objects, COLUMNS[0].value) for group in section.groups]
    errors = [axes.cells(group.objects, _solved("add_s_mm")).mean for group in section.groups]
    ranks = [(-1.0 if r.mean is None else r.mean, -np.inf if e is None else -e)
             for r, e in zip(recalls, errors, strict=True)]  # fmt: skip
    best = ranks.index(max(ranks))
    lines = tuple(
        _line(group, axes, drawn, recalls[k], None if k == best else recalls[best], _ar(group, axes, bop))
        for k, group in enumerate(section.groups)
    )
    return GroupComparison(section, lines, lines[best], axes)


def _line(group: Group, axes: Axes, drawn: Draws, recall: CellSums, best: CellSums | None, ar: CellSums) -> GroupLine:
    objects = group.objects
    errors = [(row.add_s_mm, *axes.place(row)) for row in objects if row.status == "ok" and row.add_s_mm is not None]
    values, units, models = np.array(errors).reshape(-1, 3).T
    frame_ms = _frame_ms(group, axes)
    numbers = {column.id: drawn.mean(axes.cells(objects, column.value)) for column in COLUMNS}
    if all(row.right_seen is None for row in objects):  # A table of an earlier version lacks the column.
        numbers["recall_seen"] = None
    numbers["ar"] = drawn.mean(ar)
    numbers["median_mm"] = drawn.median(values, units.astype(int), models.astype(int))
    numbers["ms_per_frame"] = drawn.median(frame_ms[:, 0], frame_ms[:, 1].astype(int), None)
    hits = _hits(group.with_truth, axes)
    curve = (hits.sum(axis=(0, 1)) / recall.n.sum(), drawn.band(hits, recall.n)) if recall.n.any() else None
    behind = None if best is None else drawn.difference(recall, best)
    return GroupLine(group, {name: one for name, one in numbers.items() if one is not None}, behind, curve, recall, ar)


def _ar(group: Group, axes: Axes, bop: BopRecalls) -> CellSums:
    total, n = np.zeros(axes.shape), np.zeros(axes.shape)
    folders = {run.folder for run in group.runs}
    for (folder, frame, obj_id), (n_targets, ar) in bop.by_place.items():
        if folder in folders:
            place = axes.unit(frame), axes.models[obj_id]
            total[place] += n_targets * ar
            n[place] += n_targets
    return CellSums(total, n)


def _frame_ms(group: Group, axes: Axes) -> Float:
    """(N, 2) computing time of the iterations of each frame of each run [ms], and the frame's index in the cells."""
    times: dict[tuple[int, str], tuple[float, int]] = {}
    for k, run in enumerate(group.runs):
        for row in run.rows:
            if row.status != "failed":
                ms, _ = times.get((k, row.frame), (0.0, 0))
                times[k, row.frame] = ms + row.ms_total, axes.unit(row.frame)
    return np.array(list(times.values())).reshape(-1, 2)


def _hits(rows: Sequence[Answer], axes: Axes) -> Float:
    """(U, M, T) numbers of objects below each threshold; an object without an answer is below none."""
    hits = np.zeros((*axes.shape, len(THRESHOLDS)))
    for row in rows:
        if row.relative_error is not None:
            # An error counts at all thresholds above it.
            hits[axes.place(row)][np.searchsorted(THRESHOLDS, row.relative_error, side="right") :] += 1
    return hits


def stage_times(group: Group) -> dict[str, float]:
    """Milliseconds per frame and stage, in the order of processing, the mean of the runs; empty = unknown.

    Iterations are split into the parts that the rows hold: refining, simulating, scoring.
    """
    times = list[dict[str, float]]()
    for run in group.runs:
        n = len({row.frame for row in run.rows if row.status != "failed"})
        if not n:
            continue
        stages = dict(run.run.totals.mean_stages_ms_per_frame)
        refine, simulate, score, total = (
            sum(getattr(row, f"ms_{part}") for row in run.rows) / n for part in ("refine", "simulate", "score", "total")
        )
        rest = max(stages.pop("iterate", total) - refine - simulate - score, 0.0)
        first = {name: stages.pop(name) for name in ("read", "prepare", "start") if name in stages}
        times.append({**first, "refine": refine, "simulate": simulate, "score": score, "rest": rest, **stages})
    names = dict.fromkeys(name for mine in times for name in mine)
    return {name: float(np.mean([mine.get(name, 0.0) for mine in times])) for name in names}


def cause_counts(group: Group) -> Counter[str]:
    """Failures by cause, "" for unexplained ones; none without ground truth."""
    return Counter(cause_title(row.cause) for row in group.failures) if group.with_truth else Counter()


def object_numbers(comparison: GroupComparison) -> list[ObjectNumbers]:
    """The numbers of each object model in each group, None where a group does not have it."""
    rows = list[ObjectNumbers]()
    for obj_id, place in comparison.axes.models.items():
        cells = [_object_cell(line, obj_id, place) for line in comparison.lines]
        name = next((r.name for line in comparison.lines for r in line.group.objects if (r.obj_id or 0) == obj_id), "")
        if any(cells):
            rows.append(ObjectNumbers(obj_id, name, cells))
    return rows


def _object_cell(line: GroupLine, obj_id: int, place: int) -> ObjectCell | None:
    mine = [row for row in line.group.objects if (row.obj_id or 0) == obj_id]
    if not mine:
        return None
    errors = [row.add_s_mm for row in mine if row.status == "ok" and row.add_s_mm is not None]
    scores = [row.score for row in mine if row.status == "ok" and row.score is not None]
    widths = [row.undetermined_mm for row in mine if row.status == "ok" and row.undetermined_mm is not None]
    causes = Counter(row.cause for row in mine if row.cause)

    def share(cells: CellSums) -> float | None:
        n = cells.n[:, place].sum()
        return round(float(100 * cells.total[:, place].sum() / n), 2) if n else None

    return ObjectCell(
        n=len(mine),
        right=share(line.recall),
        ar=share(line.ar),
        median_mm=round(float(np.median(errors)), 2) if errors else None,
        score=round(float(np.mean(scores)), 3) if scores else None,
        undetermined_mm=round(float(np.mean(widths)), 2) if widths else None,
        cause=cause_title(causes.most_common(1)[0][0]) if causes else "",
    )


def hardest(section: Section, keys: Mapping[int, int]) -> list[HardObject]:
    """Objects in frames that most groups get wrong with most seeds, the hardest first.

    Args:
        section: the groups.
        keys: id of an answer → its key in the gallery.
    """
    by_object: dict[Any, dict[str, list[Answer]]] = {}
    for group in section.groups:
        for row in group.with_truth:
            by_object.setdefault(key(row), {}).setdefault(group.name, []).append(row)
    hard = list[HardObject]()
    for by_group in by_object.values():
        rows = [row for mine in by_group.values() for row in mine]
        right = {name: sum(row.is_correct is True for row in mine) for name, mine in by_group.items()}
        n_wrong = sum(2 * right[name] < len(mine) for name, mine in by_group.items())
        if 2 * n_wrong > len(by_group):
            best = max(by_group, key=lambda name: right[name] / len(by_group[name]))
            causes = Counter(row.cause for row in rows if row.cause)
            worst = max(rows, key=lambda row: np.inf if row.relative_error is None else row.relative_error)
            hard.append(
                HardObject(
                    key=keys[id(worst)],
                    frame=worst.frame,
                    name=worst.name,
                    wrong_groups=n_wrong,
                    groups=len(by_group),
                    right=sum(right.values()),
                    n=len(rows),
                    best=BestGroup(best, right[best], len(by_group[best])) if right[best] else None,
                    cause=cause_title(causes.most_common(1)[0][0]) if causes else "",
                )
            )
    return sorted(hard, key=lambda one: (-one.wrong_groups, one.right / one.n, one.frame))


def score_misleads(group: Group) -> float | None:
    """Share of all pairs of a wrong and a right answer in which the wrong one scores higher."""
    share = misranked_share(group.objects)
    return None if share is None else round(share, 4)
