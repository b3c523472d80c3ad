"""Of how many frames the data are in doubt, and why: what to look at before all else."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from verefine_viz.batch.rows import ObjectRow
from verefine_viz.diagnosis.words import DATA_FIRST

MOST_REASONS = 2
"""Reasons that are told; frames with others are counted."""


@dataclass
class Reason:
    """Why the data of some frames are in doubt."""

    first: str
    """The first of these frames."""
    why: str
    """As it is told of that frame."""
    n_frames: int = 0

    def in_words(self) -> str:
        """As in: In 3, such as 50/1, objects appear 11% larger: check cam_K."""
        where = f"frame {self.first}" if self.n_frames == 1 else f"{self.n_frames}, such as {self.first}"
        return f"In {where}, {self.why}."


class Doubts:
    """What is in doubt in many frames. It stays as small as there are reasons, however many frames there are.

    Two reasons that differ in their numbers only are the same.
    """

    def __init__(self) -> None:
        self._reasons: dict[str, Reason] = {}

    def add(self, frame: str, why: str) -> None:
        """Takes a frame whose data are in doubt; ``frame`` as people are to read it."""
        why = why.removesuffix(".")
        reason = self._reasons.setdefault(re.sub(r"\d+(\.\d+)?", "#", why), Reason(frame, why))
        reason.n_frames += 1

    def in_words(self, n_frames: int, n_runs: int = 1) -> str:
        """In how many of ``n_frames`` frames, of all runs together, and why, most frequent first; empty: in none."""
        reasons = sorted(self._reasons.values(), key=lambda reason: -reason.n_frames)
        if not reasons:
            return ""
        found = sum(reason.n_frames for reason in reasons)
        of = f"{found} of {n_frames} frames" + (f" of {n_runs} runs" if n_runs > 1 else "")
        first, *others = reasons
        if not others:
            where = f"frame {first.first}" if found == 1 else f"{of}, such as {first.first}"
            return f"{DATA_FIRST} in {where}, {first.why}."
        told = [f"{DATA_FIRST} in {of}.", *(reason.in_words() for reason in reasons[:MOST_REASONS])]
        n_left = sum(reason.n_frames for reason in reasons[MOST_REASONS:])
        if n_left:
            told.append(
                "1 other frame has another reason." if n_left == 1 else f"{n_left} other frames have other reasons."
            )
        return " ".join(told)


def doubts_in_words(runs: Sequence[tuple[str, Iterable[ObjectRow]]]) -> str:
    """:meth:`Doubts.in_words` of the rows of one or several (run, rows); of several a frame is named with its run."""
    doubts, n_frames = Doubts(), 0
    for run, rows in runs:
        # All objects of a frame say the same; those whose answers are right say nothing.
        found: dict[str, str] = {}
        for row in rows:
            found[row.frame] = found.get(row.frame, "") or row.doubt
        n_frames += len(found)
        for frame, why in found.items():
            if why:
                doubts.add(f"{frame} of {run}" if len(runs) > 1 else frame, why)
    return doubts.in_words(n_frames, len(runs))
