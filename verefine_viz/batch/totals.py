"""Totals of a batch's results: counts while it runs, medians at its end."""

from __future__ import annotations

import re
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from verefine_viz.run.record import DATA_FIRST, Answer, RunEnd, RunRecord

MOST_REASONS = 2
"""Reasons for doubt that are named; frames with others are counted."""
MOST_FAILURES = 10
"""Failed frames whose reason is quoted; the others are counted."""
MOST_NOTES = 20
"""Different notes that are counted and shown."""
_NUMBER = re.compile(r" \(#\d+\)| \(\d+ of \d+, RᵀR [^)]*\)$|(?<= has no ground truth): .*$")
"""Parts of a note that differ between frames, such as the number behind an object's name; ignored in counting."""


@dataclass
class Reason:
    """Why the data of some frames are in doubt."""

    first: str
    """The first of these frames."""
    why: str
    """The reason, as reported for that frame."""
    n_frames: int = 0

    def describe(self) -> str:
        """Return "In 3, such as 50/1, objects appear 11% larger: check cam_K."."""
        where = f"frame {self.first}" if self.n_frames == 1 else f"{self.n_frames}, such as {self.first}"
        return f"In {where}, {self.why}."


class Doubts:
    """Doubts about the data of many frames, counted by reason: memory grows with the reasons, not with the frames.

    Reasons that differ in their numbers only count as one.
    """

    def __init__(self) -> None:
        self._reasons: dict[str, Reason] = {}

    def add(self, frame: str, why: str) -> None:
        """Count a frame whose data are in doubt; ``frame`` is its name in the text."""
        why = why.removesuffix(".")
        reason = self._reasons.setdefault(re.sub(r"\d+(\.\d+)?", "#", why), Reason(frame, why))
        reason.n_frames += 1

    def describe(self, n_frames: int, n_runs: int = 1) -> str:
        """Say how many of the ``n_frames`` frames of all runs are in doubt and why, most frequent first; "" = none."""
        reasons = sorted(self._reasons.values(), key=lambda reason: -reason.n_frames)
        if not reasons:
            return ""
        n_doubtful = sum(reason.n_frames for reason in reasons)
        of = f"{n_doubtful} of {n_frames} frames" + (f" of {n_runs} runs" if n_runs > 1 else "")
        first, *others = reasons
        if not others:
            where = f"frame {first.first}" if n_doubtful == 1 else f"{of}, such as {first.first}"
            return f"{DATA_FIRST} in {where}, {first.why}."
        sentences = [f"{DATA_FIRST} in {of}.", *(reason.describe() for reason in reasons[:MOST_REASONS])]
        n_left = sum(reason.n_frames for reason in reasons[MOST_REASONS:])
        if n_left:
            sentences.append(
                "1 other frame has another reason." if n_left == 1 else f"{n_left} other frames have other reasons."
            )
        return " ".join(sentences)


def describe_doubts(runs: Sequence[tuple[str, Iterable[Answer]]]) -> str:
    """:meth:`Doubts.describe` for the rows of runs, (name, rows) each; of several runs, a frame names its own."""
    doubts, n_frames = Doubts(), 0
    for run, rows in runs:
        # Objects of a frame have the same doubts, or none where their answer is right.
        by_frame: dict[str, str] = {}
        for row in rows:
            by_frame[row.frame] = by_frame.get(row.frame, "") or "".join(row.doubts[:1])
        n_frames += len(by_frame)
        for frame, why in by_frame.items():
            if why:
                doubts.add(f"{frame} of {run}" if len(runs) > 1 else frame, why)
    return doubts.describe(n_frames, len(runs))


class Notes:
    """Counts in how many frames, or runs, each note appears; only the first ``most`` different notes are kept.

    Notes count as one if they differ only in the number of an object in its frame, in how many rotations are rounded,
    or in what is wrong with ground truth that cannot be used.
    """

    def __init__(self, most: int = MOST_NOTES) -> None:
        self._most = most
        self._often: Counter[str] = Counter()
        self._shown: dict[str, str] = {}

    def add(self, notes: Iterable[str]) -> None:
        """Count the notes of one frame or run."""
        by_kind: dict[str, str] = {}
        for note in notes:
            kind = _NUMBER.sub("", note)
            by_kind[kind] = note if by_kind.get(kind, note) == note else kind
        for kind, note in by_kind.items():
            if kind not in self._often and len(self._often) >= self._most:
                continue
            self._often[kind] += 1
            self._shown[kind] = note if self._shown.get(kind, note) == note else kind

    def counted(self) -> dict[str, int]:
        """How often each note appeared, most frequent first; an object's number is left out where it differs."""
        return {self._shown[kind]: n for kind, n in self._often.most_common()}


@dataclass
class BatchCounts:
    """Counts of frames and objects, updated with each frame."""

    frames_done: int = 0
    frames_failed: int = 0
    objects: int = 0
    """All known objects, those of failed frames included."""
    answers_with_truth: int = 0
    objects_without_answer: int = 0
    """Objects without a hypothesis."""
    objects_left_out: int = 0
    """Objects without a usable mask or model, or not detected."""
    objects_unreadable: int = 0
    """Left-out objects whose mask or model is missing or damaged."""
    objects_in_failed_frames: int = 0
    objects_with_truth: int = 0
    objects_correct: int = 0

    def add(self, end: RunEnd) -> None:
        """Count a finished frame."""
        self.frames_done += 1
        self.frames_failed += end.failed
        self.objects_unreadable += end.n_unreadable
        for row in end.answers:
            if not row.is_object:
                continue
            self.objects += 1
            self.answers_with_truth += row.add_s_mm is not None
            self.objects_without_answer += row.status == "no_answer"
            self.objects_left_out += row.status == "left_out"
            self.objects_in_failed_frames += row.status == "failed"
            self.objects_with_truth += row.has_truth
            self.objects_correct += row.is_correct is True

    @property
    def recall(self) -> float | None:
        """Share of the objects with ground truth whose ADD(-S) is below 10 % of the diameter; no answer is a miss."""
        return self.objects_correct / self.objects_with_truth if self.objects_with_truth else None


@dataclass
class Totals:
    """Everything in run.json about the results, added up frame by frame."""

    counts: BatchCounts = field(default_factory=BatchCounts)
    failures: list[tuple[str, str]] = field(default_factory=list)
    """Frame and reason of the first frames that failed."""
    doubts: Doubts = field(default_factory=Doubts)
    """Doubts about the frames' data."""
    notes: Notes = field(default_factory=Notes)
    _scores: array[float] = field(default_factory=lambda: array("d"))
    _errors_mm: array[float] = field(default_factory=lambda: array("d"))
    _times_ms: array[float] = field(default_factory=lambda: array("d"))
    _stages_ms: dict[str, float] = field(default_factory=dict)
    _causes: Counter[str] = field(default_factory=Counter)

    def passing(self, records: Iterable[RunRecord]) -> Iterator[RunRecord]:
        """Yield the records as they come; finished ones are counted on the way."""
        for record in records:
            if record.end is not None:
                self._add(record.header.frame, record.end)
            yield record

    def _add(self, frame: str, end: RunEnd) -> None:
        self.counts.add(end)
        if end.failed and len(self.failures) < MOST_FAILURES:
            self.failures.append((frame, end.answers[0].message))
        if end.doubts:
            self.doubts.add(frame, end.doubts[0])
        for name, ms in end.stages_ms.items():
            self._stages_ms[name] = self._stages_ms.get(name, 0.0) + ms
        self.notes.add(end.notes)
        for row in end.answers:
            if row.cause:
                self._causes[row.cause] += 1
            if row.status == "ok":
                self._times_ms.append(row.ms_total)
                if row.score is not None:
                    self._scores.append(row.score)
                if row.add_s_mm is not None:
                    self._errors_mm.append(row.add_s_mm)

    def as_json(self, n_frames: int) -> dict[str, Any]:
        """The entry ``totals`` of run.json: :class:`verefine_viz.batch.runs.RunTotals`."""
        counts, n_solved = self.counts, self.counts.frames_done - self.counts.frames_failed
        return {
            "frames": n_frames,
            **asdict(counts),
            "recall": counts.recall,
            "causes": dict(self._causes.most_common()),
            "data_in_doubt": self.doubts.describe(counts.frames_done),
            "notes": self.notes.counted(),
            "median_score": _median(self._scores),
            "median_add_s_mm": _median(self._errors_mm),
            "median_ms_per_object": _median(self._times_ms),
            "mean_stages_ms_per_frame": {name: ms / max(n_solved, 1) for name, ms in self._stages_ms.items()},
        }


def _median(values: array[float]) -> float | None:
    return float(np.median(values)) if values else None


def misranked_share(rows: Iterable[Answer]) -> float | None:
    """How often the score misleads: the share of pairs (wrong, right answer) in which the wrong one scores higher.

    0 = it separates wrong from right, ½ = no better than chance; None where there are no such pairs.
    """
    scores = [(row.is_correct, row.score) for row in rows if row.score is not None]
    wrong = np.array([score for is_correct, score in scores if is_correct is False])
    right = np.sort(np.array([score for is_correct, score in scores if is_correct]))
    if not len(wrong) or not len(right):
        return None
    below = np.searchsorted(right, wrong, "left")
    level = np.searchsorted(right, wrong, "right") - below
    return float((below + level / 2).sum() / (len(wrong) * len(right)))
