"""A recording drawn from its journal, block by block or at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rerun as rr
from rerun.chunk import Chunk

from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.recording import columns, entities
from verefine_viz.recording.background import background
from verefine_viz.recording.blueprint import blueprint_messages
from verefine_viz.recording.direct_file import DirectFile
from verefine_viz.recording.drawing import Drawing
from verefine_viz.recording.graph import dependency_chunks
from verefine_viz.recording.journal import JournalReader
from verefine_viz.recording.layout import Layout


def part_path(path: Path) -> Path:
    """Where a recording lies while it is written."""
    return path.with_name(path.name + ".part")


def journal_path(path: Path) -> Path:
    """The journal beside a recording that is being written."""
    return path.with_name(path.name + ".journal")


@dataclass(frozen=True, eq=False)
class Job:
    """A recording to be drawn, but for its iterations."""

    path: Path
    """Its final name."""
    about: Mapping[str, Any]
    layout: Layout
    problem: Problem


class Drawn:
    """Draws what its journal holds into the ``.part`` of a recording without maps."""

    def __init__(self, job: Job) -> None:
        """Draws the frame.

        Raises:
            InputError: the file cannot be written.
        """
        self._job = job
        self._drawing = Drawing(job.layout)
        self._journal = JournalReader(journal_path(job.path))
        try:
            self._file = DirectFile(part_path(job.path))
        except OSError as error:
            raise InputError(f"cannot write the recording {job.path}: {error.strerror}") from None
        self._file.send(frame_chunks(job, self._drawing, pictures=False))

    def more(self) -> None:
        """Draws what was added to the journal since the last call.

        Raises:
            InputError: the disk does not take it.
        """
        rows = self._journal.rows()
        if rows:
            self._file.send(self._drawing.draw(rows))

    def end(self) -> None:
        """Draws the rest, gives the file its name and removes the journal.

        Raises:
            InputError: the disk does not take it.
        """
        self.more()
        self._file.close(blueprint_messages(self._job.layout, has_maps=False))
        name_finished(self._job.path)


def name_finished(path: Path) -> None:
    """Gives a finished recording its name; the journal is not needed any more.

    Raises:
        InputError: its name cannot be given to it.
    """
    try:
        part_path(path).replace(path)
        journal_path(path).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"cannot write the recording {path}: {error.strerror}") from None


def draw_whole(job: Job) -> None:
    """Draws a recording whose journal is complete.

    Raises:
        InputError: it cannot be written.
    """
    Drawn(job).end()


def frame_chunks(job: Job, drawing: Drawing, pictures: bool) -> Iterator[Chunk]:
    """Everything that is known before the first iteration; what makes the iterations readable comes first."""
    yield from property_chunks(job.about)
    yield from drawing.start()
    if job.problem.dependencies is not None and job.layout.is_scene:
        yield from dependency_chunks(job.problem.dependencies, job.layout)
    yield from background(job.problem, pictures)


def property_chunks(about: Mapping[str, Any]) -> Iterator[Chunk]:
    """What a recording is about as it holds it, and its name."""
    yield Chunk.from_property(entities.PROPERTY, rr.AnyValues(**about))
    name = f"{about['title']} {about['frame']} {about['method']}".strip()
    yield columns.fixed("/__properties", rr.archetypes.RecordingInfo(name=name))
