"""The journal of a batch: a small file per finished frame, so that neither a kill nor the number of frames matters.

Results live on the disk and not in memory; whoever wants them all reads them one after the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from pydantic import ValidationError

from verefine_viz.batch.rows import FrameResult, frame_name
from verefine_viz.core.atomic import atomic
from verefine_viz.core.errors import InputError


class Journal:
    """The folder ``frames/`` of a batch."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def keep(self, result: FrameResult) -> None:
        """Notes a finished frame, solved or failed; from now on a restart does not repeat it.

        Raises:
            InputError: the disk refuses.
        """
        with atomic(self._file(result.frame)) as part:
            part.write_text(result.model_dump_json(), encoding="utf-8")

    def read(self, frame: str) -> FrameResult | None:
        """What was noted about a frame; None where there is nothing that can be used."""
        try:
            result = FrameResult.model_validate_json(self._file(frame).read_bytes())
        except (OSError, ValidationError):
            return None  # Not there, not ours, or damaged: the frame is solved again.
        return result if result.frame == frame else None

    def results(self, frames: Iterable[str]) -> Iterator[FrameResult]:
        """What was noted about ``frames``, in their order, one at a time; frames that are not finished are left out."""
        for frame in frames:
            result = self.read(frame)
            if result is not None:
                yield result

    def clear_parts(self) -> None:
        """Removes what killed writers left half-written. Only for the one process that writes here."""
        try:
            for part in self.folder.glob("*.part"):
                part.unlink()
        except OSError as error:
            raise InputError(f"cannot write to {self.folder}: {error.strerror}") from None

    def _file(self, frame: str) -> Path:
        return self.folder / f"{frame_name(frame)}.json"
