"""Two runs compared object by object: which answers got better, which got worse."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from verefine_viz.core.geometry import angle_between, apply
from verefine_viz.page.gallery_messages import ApartAnswers, FrameChange, ObjectChange, PairDifference
from verefine_viz.report.groups import Group, key
from verefine_viz.run.record import Answer

SAME = 0.005
"""Errors that differ by less than this share of the diameter count as the same."""
MOST_ROWS = 1000
"""Most objects and frames that are listed, by size of the change; all are in frames.csv."""


@dataclass(frozen=True)
class PairChange:
    """One object of one frame in both runs."""

    a: Answer
    b: Answer

    @property
    def errors(self) -> tuple[float, float]:
        """As shares of the diameter; infinite without an answer."""
        return _error_or_infinite(self.a), _error_or_infinite(self.b)

    @property
    def by(self) -> float:
        """Error of B minus that of A, as a share of the diameter: negative where B is better."""
        a, b = self.errors
        if math.isinf(a) or math.isinf(b):
            return 0.0 if a == b else math.copysign(math.inf, b - a)
        return b - a

    @property
    def turned(self) -> Literal["", "right", "wrong"]:
        """Whether it became right or wrong; "" where it did neither."""
        before, after = self.a.is_correct is True, self.b.is_correct is True
        return "" if before == after else ("right" if after else "wrong")


def _error_or_infinite(row: Answer) -> float:
    """ADD(-S) of the answer as a share of the diameter; infinite where there is no answer or no ground truth."""
    return math.inf if row.relative_error is None else row.relative_error


def changes_of(a: Group, b: Group) -> list[PairChange]:
    """The objects with ground truth in both groups, the most improved first."""
    of_b = {key(row): row for row in b.objects}
    with_truth = {key(row) for row in (*a.with_truth, *b.with_truth)}
    both = [PairChange(row, of_b[key(row)]) for row in a.objects if key(row) in of_b and key(row) in with_truth]
    return sorted(both, key=lambda change: (change.by, change.a.frame))


def difference(a: Group, b: Group, keys: Mapping[int, int]) -> PairDifference:
    """The changes from A to B.

    Args:
        a: one run.
        b: another one.
        keys: id of an answer → its key in the gallery.
    """
    changes = changes_of(a, b)
    shown = changes if len(changes) <= MOST_ROWS else [*changes[: MOST_ROWS // 2], *changes[-MOST_ROWS // 2 :]]
    of_a, of_b = ({key(row) for row in group.objects} for group in (a, b))
    return PairDifference(
        n=len(changes),
        better=sum(change.by < -SAME for change in changes),
        worse=sum(change.by > SAME for change in changes),
        now_right=sum(change.turned == "right" for change in changes),
        now_wrong=sum(change.turned == "wrong" for change in changes),
        both_wrong=sum(not change.a.is_correct and not change.b.is_correct for change in changes),
        only=(len(of_a - of_b), len(of_b - of_a)),
        same=100 * SAME,
        objects=[
            ObjectChange(
                frame=change.a.frame,
                name=change.a.name,
                turned=change.turned,
                errors=(_percent(change.errors[0]), _percent(change.errors[1])),
                by=_percent(change.by),
                keys=(keys[id(change.a)], keys[id(change.b)]),
            )
            for change in shown
        ],
        frames=_frames(changes)[:MOST_ROWS],
    )


def apart(a: Group, b: Group, keys: Mapping[int, int]) -> list[ApartAnswers]:
    """Objects with an answer in both runs, those whose answers are farthest apart first: all that is known of a
    difference without ground truth.

    Args:
        a: one run.
        b: another one.
        keys: id of an answer → its key in the gallery.
    """
    of_b = {key(row): row for row in b.objects}
    both = list[ApartAnswers]()
    for one in a.objects:
        other = of_b.get(key(one))
        if one.T_cam_obj is None or other is None or other.T_cam_obj is None:
            continue
        middle = np.zeros((1, 3)) if one.middle_m is None else one.middle_m[None]
        (shift,) = apply(other.T_cam_obj, middle) - apply(one.T_cam_obj, middle)
        turn = angle_between(one.T_cam_obj[:3, :3], other.T_cam_obj[:3, :3])
        both.append(
            ApartAnswers(
                frame=one.frame,
                name=one.name,
                mm=round(1e3 * float(np.linalg.norm(shift)), 2),
                deg=round(math.degrees(turn), 2),
                scores=(one.score, other.score),
                keys=(keys[id(one)], keys[id(other)]),
            )
        )
    return sorted(both, key=lambda one: (-one.mm, one.frame))[:MOST_ROWS]


def wrong_in(a: Group, b: Group) -> dict[int, str]:
    """Which of two runs got an object wrong, in words, by the id of its answers."""
    of_a, of_b = ({key(row) for row in group.failures if _is_missed(row)} for group in (a, b))
    words = {(True, True): "both wrong", (True, False): f"only {a.name} wrong", (False, True): f"only {b.name} wrong"}
    return {
        id(row): words[key(row) in of_a, key(row) in of_b]
        for row in (*a.objects, *b.objects)
        if key(row) in of_a or key(row) in of_b
    }


def _is_missed(row: Answer) -> bool:
    """Whether an answer is missing, or known to be wrong."""
    return row.status == "no_answer" or row.is_correct is False


def _frames(changes: Sequence[PairChange]) -> list[FrameChange]:
    """Both runs frame by frame, the most improved first; errors are means over objects with an answer in both."""
    by_frame: dict[str, list[PairChange]] = {}
    for change in changes:
        by_frame.setdefault(change.a.frame, []).append(change)
    frames = list[tuple[float, FrameChange]]()
    for frame, mine in by_frame.items():
        both = [change.errors for change in mine if all(map(math.isfinite, change.errors))]
        a, b = np.mean(both, axis=0).tolist() if both else (math.nan, math.nan)
        right = [sum(row.is_correct is True for row in rows) for rows in zip(*((c.a, c.b) for c in mine), strict=True)]
        by = 0.0 if math.isnan(b - a) else b - a
        frames.append((by, FrameChange(frame, len(mine), (_percent(a), _percent(b)), right)))
    return [frame for _, frame in sorted(frames, key=lambda one: (one[0], one[1].frame))]


def _percent(share: float) -> float | None:
    """Share of the diameter in %; None without an answer."""
    return round(100 * share, 3) if math.isfinite(share) else None
