"""The journal of a batch: a small file per finished frame, so that neither a kill nor the number of frames matters.

Results live on the disk and not in memory; whoever wants them all reads them one after the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from pydantic import ValidationError

from verefine_viz.batch.rows import FrameResult, frame_name
from verefine_viz.core.atomic import atomic
from verefine_viz.core.errors import InputError, first_fault
from verefine_viz.core.input_files import read_input


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

    def entry(self, frame: str) -> FrameResult | None:
        """What was noted about a frame; None where nothing was.

        Raises:
            InputError: the entry is damaged; the text says how.
        """
        file = self._file(frame)
        if not file.exists():
            return None
        content = read_input(file)
        try:
            result = FrameResult.model_validate_json(content)
        except ValidationError as error:
            raise InputError(f"{file} is damaged: {first_fault(error)}") from None
        if result.frame != frame:
            raise InputError(f"{file} is damaged: it is about frame {result.frame}")
        if not result.objects:
            raise InputError(f"{file} is damaged: it holds no object")
        return result

    def read(self, frame: str) -> FrameResult | None:
        """What was noted about a frame; None where there is nothing that can be used."""
        with suppress(InputError):
            return self.entry(frame)
        return None

    def results(self, frames: Iterable[str]) -> Iterator[FrameResult]:
        """What was noted about ``frames``, in their order, one at a time; frames that are not finished are left out."""
        for frame in frames:
            result = self.read(frame)
            if result is not None:
                yield result

    def _file(self, frame: str) -> Path:
        return self.folder / f"{frame_name(frame)}.json"
