"""The gallery of batches, and the report of them. Errors are null without ground truth or without an answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from msgspec import UNSET, UnsetType

from verefine_viz.page.wire import Message, Part

CardTone = Literal["waiting", "none", "doubt", "unknown", "right", "seen", "wrong"]
Interval = tuple[float | None, float | None, float | None]
"""[value, low, high], in the unit that is shown; low and high are null where nothing could be drawn."""


class GalleryOrder(Part, frozen=True):
    """One way to sort the gallery."""

    id: str
    words: str
    keys: Sequence[int]
    """All answers in that order."""


class GalleryRow(Part, frozen=True):
    """An answer as a card; its index in `rows` is its key."""

    key: int
    run: str
    """Name of its run's folder."""
    frame: str
    obj: int | None
    """null for a frame that failed as a whole, or waits."""
    object: int | None
    """Its model."""
    name: str
    method: str
    tone: CardTone
    result: str
    """Its result, to filter by."""
    score: float | None
    err: float | None
    """ADD(-S) [mm]."""
    err_seen: float | None
    """ADD(-S) to the nearest pose that the image allows beside ground truth [mm]."""
    limit: float | None
    """Largest error of a right answer [mm]."""
    k: int
    """The iteration to open."""
    cause: str
    """Its title."""
    evidence: str
    status: str
    message: str
    """Why there is no answer."""
    visible: float | None
    """Share that is not hidden, 0 to 1."""
    undetermined_mm: float | None
    undetermined_deg: float | None
    ms: float
    """Time of its iterations."""
    tags: Sequence[str]
    opens: bool
    """Whether its frame can be opened."""
    thumb: bool
    """Whether it has a small picture."""
    film: bool
    """Whether it has a film."""
    group: str | UnsetType = UNSET
    """Only in reports, as all below: the group of its run."""
    compared: str | UnsetType = UNSET
    """Which of two runs is wrong, in words."""
    command: str | UnsetType = UNSET
    """Opens the frame in the program."""
    part: int | UnsetType | None = UNSET
    """Number of the part of the document that holds its frame."""
    file: str | UnsetType | None = UNSET
    """File beside the report that holds its frame."""


class AnswersMessage(Message, frozen=True):
    """The gallery; sent again when a watched folder changes or a tag is set."""

    outcome: str
    """How many objects are right, in words."""
    doubt: str
    """How many frames have doubtful data, and why."""
    notes: Sequence[str]
    """What cannot be read."""
    runs: Sequence[str]
    unfinished: int
    """Unfinished runs beside them."""
    faults: Sequence[str]
    """Why tags cannot be read."""
    first: dict[str, str]
    """Filters until the user chooses others: values by filter."""
    orders: Sequence[GalleryOrder]
    rows: Sequence[GalleryRow]
    frames: Sequence[str] | UnsetType | None = UNSET
    """In a watched folder: frames of the open session now."""


# Remedies that were tried


class FixedAnswer(Part, frozen=True):
    """An answer before and after a remedy."""

    key: int | None
    """In the gallery; null where it is not there."""
    name: str
    frame: str
    was_bad: bool
    change: Literal[-1, 0, 1]
    """1: came right, or fits better; -1: broke, or fits worse."""
    errors: tuple[float | None, float | None]
    """ADD(-S) before and after [mm]."""
    scores: tuple[float | None, float | None]
    recording: str
    """The run with the remedy; "" where it cannot be opened from here."""


class FixLine(Part, frozen=True):
    """What a remedy did for a cause, as a row of fix.csv (docs/tables.md)."""

    remedy: str
    cause: str
    """Its title."""
    fit: bool
    """Whether answers are compared by their fit, as without ground truth."""
    tried: int
    came_right: int
    worse: int
    right_tried: int
    broke: int
    right_known: int
    net: Interval
    seconds: float | None
    """Computing time added per frame."""
    answers: Sequence[int]
    """Answers that were tried, and those that were right: indices in the table's list."""


class FixShown(Part, frozen=True):
    """The table of the remedies that were tried."""

    rows: Sequence[FixLine]
    answers: Sequence[FixedAnswer]


class FixMessage(Message, frozen=True):
    """The trial of remedies on the runs of the gallery, running or finished."""

    running: bool
    done: int
    """Frames done, of `total`."""
    total: int
    fault: str
    """Why it ended early."""
    table: FixShown | None


# The report


class ReportColumn(Part, frozen=True):
    """A number of a group."""

    id: str
    label: str
    hint: str
    unit: str
    digits: int
    better: int
    """1: more is better, -1: less, 0: neither."""


class NextStep(Part, frozen=True):
    """A recommendation of what to look at next."""

    group: int
    text: str
    key: int
    """The answer to begin with."""
    begin: str
    """Its name and frame."""


class RecallCurve(Part, frozen=True):
    """Recall over the thresholds [%], and where several runs or frames allow it its 95 % interval."""

    recall: Sequence[float]
    low: Sequence[float | None] | None
    high: Sequence[float | None] | None


class ReportGroup(Part, frozen=True):
    """Runs that differ only in their seeds."""

    name: str
    runs: Sequence[str]
    n_objects: int
    n_with_truth: int
    numbers: dict[str, Interval]
    """By column."""
    behind: Interval | None
    """Difference of recall to the best group's [%]; null for the best group."""
    curve: RecallCurve | None
    causes: Sequence[tuple[str, int]]
    """[title, failures], the most frequent first."""
    misleads: float | None
    """Share of the pairs of a wrong and a right answer in which the wrong one scores higher."""
    stages: dict[str, float]
    """Milliseconds a frame."""
    grasps: Sequence[tuple[str, int, int]]
    """[end, by answers, by ground truth]."""
    made: Sequence[str]
    """Version, date, time and machine of its first run."""
    session: str
    """TOML."""


class ObjectCell(Part, frozen=True):
    """An object model in one group."""

    n: int
    right: float | None
    """Share [%]."""
    ar: float | None
    """BOP average recall [%]."""
    median_mm: float | None
    score: float | None
    undetermined_mm: float | None
    cause: str
    """The most frequent cause."""


class ObjectNumbers(Part, frozen=True):
    """An object model over the groups; null where a group does not have it."""

    id: int
    name: str
    cells: Sequence[ObjectCell | None]


class BestGroup(Part, frozen=True, array_like=True):
    """Which group gets an object right most often; ``[name, right, n]``."""

    name: str
    right: int
    n: int


class HardObject(Part, frozen=True):
    """An object of a frame that most groups get wrong."""

    key: int
    """Its worst answer."""
    frame: str
    name: str
    wrong_groups: int
    groups: int
    right: int
    """Answers, of `n`."""
    n: int
    best: BestGroup | None
    cause: str


class ObjectChange(Part, frozen=True):
    """An object of a frame in both runs; errors are shares of the diameter [%]."""

    frame: str
    name: str
    turned: Literal["", "right", "wrong"]
    errors: tuple[float | None, float | None]
    by: float | None
    """Error of B less that of A."""
    keys: tuple[int, int]


class FrameChange(Part, frozen=True):
    """A frame in both runs; errors are means over objects that both have an answer for [%]."""

    frame: str
    n: int
    errors: tuple[float | None, float | None]
    right: Sequence[int]
    """How many of A and of B are right."""


class PairDifference(Part, frozen=True):
    """Changes from one run to the other."""

    n: int
    better: int
    worse: int
    now_right: int
    now_wrong: int
    both_wrong: int
    only: tuple[int, int]
    """Objects that only A, and only B, has."""
    same: float
    """Errors that differ by less count as the same [% of the diameter]."""
    objects: Sequence[ObjectChange]
    """The most improved first."""
    frames: Sequence[FrameChange]


class ApartAnswers(Part, frozen=True):
    """An object without ground truth whose answers differ between two runs."""

    frame: str
    name: str
    mm: float
    deg: float
    scores: tuple[float | None, float | None]
    keys: tuple[int, int]


class TrackMove(Part, frozen=True, array_like=True):
    """How an object moved on the way to a frame; ``[frame, mm, deg, kind]``."""

    frame: int
    mm: float
    deg: float
    kind: str


class ReportTrack(Part, frozen=True):
    """An object over the frames of a sequence."""

    run: str
    name: str
    scene: int
    frames: int
    flips: int
    per_100: float
    """Flips in 100 frames."""
    jumps: int
    no_pose: int
    mm: float | None
    """Median motion of frames that neither flip nor jump."""
    deg: float | None
    drift_mm: float | None
    moved: Sequence[TrackMove]
    """Objects that flip and jump most."""


class ReportSection(Part, frozen=True):
    """Runs on the same data."""

    data: str
    session_title: str
    n_frames: int
    headline: str
    next: NextStep | None
    doubt: str
    has_truth: bool
    same_objects: bool
    bop: str
    """What BOP scores are averaged over, or why there are none."""
    intervals: str
    """Meaning of the intervals."""
    best: int
    """The group."""
    groups: Sequence[ReportGroup]
    objects: Sequence[ObjectNumbers]
    hardest: Sequence[HardObject]
    n_hard: int
    differing: Sequence[tuple[str, Sequence[str]]]
    """[setting, value by group]."""
    change: PairDifference | None
    """Difference of two runs with ground truth."""
    apart: Sequence[ApartAnswers]
    """Answers that lie apart, of two runs without ground truth."""
    tracks: Sequence[ReportTrack]


class ReportMessage(Message, frozen=True):
    """Numbers of runs, each in the unit that is shown."""

    title: str
    session_title: str
    counted: str
    """How many runs, frames and objects, in words."""
    notes: Sequence[str]
    left_out: Sequence[tuple[str, str]]
    """[run, why]."""
    columns: Sequence[ReportColumn]
    thresholds: Sequence[float]
    """Thresholds of recall curves [% of the diameter]."""
    sections: Sequence[ReportSection]
    fix: FixShown | None = None
    """Remedies that were tried on these runs."""
