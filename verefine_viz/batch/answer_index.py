"""The answers of a batch's frames in one file, ``.answers``: 100 000 frames are read in seconds.

A copy of what the run files end with, which counts as long as none of them has changed since it was made.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import opened
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.writing import atomic
from verefine_viz.run.record import Answer, RunRecord
from verefine_viz.run.run_file import SUFFIX, ending, read_endings

INDEX = ".answers"


class WrittenIndex:
    """The file, which appears when ``open_files`` closes without an error; made before the run files are read."""

    def __init__(self, open_files: ExitStack, folder: Path) -> None:
        part = open_files.enter_context(atomic(folder / INDEX))
        self._file = open_files.enter_context(part.open("wb"))
        self._file.write(state_of(folder / "runs"))

    def add(self, record: RunRecord) -> None:
        if record.end is not None:
            self._file.write(ending(record.end))


def indexed_answers(folder: Path) -> tuple[Answer, ...] | None:
    """The answers of a batch, by frame; None where the file is missing, damaged, or older than a run file."""
    state = state_of(folder / "runs")
    with suppress(InputError), opened(folder / INDEX) as file:
        if file.read(len(state)) == state:
            rows = [answer for end in read_endings(file) for answer in end.answers]
            return tuple(sorted(rows, key=lambda row: parse_frame(row.frame)))
    return None


def state_of(runs: Path) -> bytes:
    """A digest of names, sizes and times of change of the run files in a folder."""
    digest = hashlib.sha256()
    for name, size, changed in sorted(_files(runs)):
        digest.update(f"{name}\0{size}\0{changed}\n".encode())
    return digest.digest()


def _files(runs: Path) -> Iterator[tuple[str, int, int]]:
    with suppress(OSError), os.scandir(runs) as entries:
        for entry in entries:
            if entry.name.endswith(SUFFIX):
                about = entry.stat()
                yield entry.name, about.st_size, about.st_mtime_ns
