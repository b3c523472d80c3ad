"""Which frames of a batch leave a recording: decided by frame and session alone, so that workers, a restart and the
check of what is on the disk agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import blake2b
from typing import Literal

from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunEnd

Keep = Literal["sample", "all", "failures", "none"]
SAMPLE = 200
"""Frames that a batch records whatever their answers; of a larger batch about as many."""


@dataclass(frozen=True)
class KeptRecordings:
    """The recordings of a batch of ``n_frames``.

    Of a batch that grows, what is kept of all its frames was kept when there were fewer.
    """

    keep: Keep
    n_frames: int
    seed: int = 0

    @staticmethod
    def of(session: Session, n_frames: int) -> KeptRecordings:
        """What ``session`` keeps; runs of the same frames with other methods or seeds of theirs record the same."""
        return KeptRecordings(session.recording.keep, n_frames, session.scene.seed)

    def always(self, frame: str) -> bool:
        """Whether a frame is recorded whatever its answers."""
        if self.keep == "sample" and self.n_frames > SAMPLE:
            drawn = blake2b(f"{self.seed} {frame}".encode(), digest_size=8).digest()
            return int.from_bytes(drawn, "big") * self.n_frames < SAMPLE * 2**64
        return self.keep in ("sample", "all")

    def holds(self, frame: str, end: RunEnd) -> bool:
        """Whether a finished frame leaves a recording; one that failed may leave none."""
        if end.failed:
            return False
        return self.always(frame) or (end.is_failure and self.keep in ("sample", "failures"))
