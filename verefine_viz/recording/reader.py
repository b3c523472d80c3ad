"""Reads recordings back: finished ones, ones whose writer was killed, and truncated ones."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import Annotated, Any

import pyarrow as pa
from pydantic import BaseModel, ConfigDict, Field, Json, ValidationError
from rerun.chunk import Chunk

from verefine_viz.core.errors import InputError, quoted
from verefine_viz.core.paths import open_input
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.recording import entities
from verefine_viz.recording.lossless_log import ENTRY, Entry, read_journal, unframed
from verefine_viz.recording.recorded_layout import Layout
from verefine_viz.recording.recorder import SCHEMA
from verefine_viz.recording.recording_file import COMPLETE, journal_path, part_path, saved_chunks

_MAGIC = b"RRF2"


@dataclass(frozen=True, eq=False)
class Recorded:
    """The content of a recording, exactly."""

    path: Path
    title: str
    frame: str
    """``scene/image``."""
    session: Session
    session_toml: str
    """The session file that makes the same run."""
    versions: Mapping[str, str]
    layout: Layout
    """The objects, their hypotheses and initial scores."""
    entries: tuple[Entry, ...]
    """Iterations 1, 2, …, without a gap."""
    is_complete: bool
    """Whether the writer finished the file, and nothing is missing since."""
    properties: Mapping[str, Any]
    """All of the above that is not iterations, as it is written."""

    @property
    def iterations(self) -> tuple[Iteration, ...]:
        return tuple(entry.iteration for entry in self.entries)


class _Properties(BaseModel):
    """The properties of a recording that are needed to read it."""

    model_config = ConfigDict(strict=True)

    title: str
    frame: Annotated[str, Field(pattern=r"^[0-9]+/[0-9]+$")]
    settings: Json[Session]
    session: str
    layout: Json[Layout]
    versions: Json[dict[str, str]]


def read_recording(path: Path) -> Recorded:
    """The recording at ``path``; that of a run still going on or killed is found by its final name as well.

    Its content is checked here; what draws it or runs it again relies on that.

    Raises:
        InputError: there is no such file, it is not a recording of this program, or it is damaged.
    """
    path = existing(path)
    if path.name == entities.SEQUENCE_FILE:
        raise InputError(
            f"{path} goes over the frames of a batch and holds no iterations: verefine-viz replay {path} shows it, "
            f"verefine-viz view {path.parent} the batch, and recordings/ there holds the run of each frame"
        )
    properties, entries, is_whole = _read(path)
    if is_part(path):
        journal = journal_path(final_path(path))
        begun, journalled = read_journal(journal) if _is_file(journal) else ({}, ())
        properties = properties or begun
        entries = _without_gap((*journalled, *entries))
    about, is_complete = _checked_properties(path, properties), is_whole and not is_part(path)
    try:
        about.layout.check(entry.iteration for entry in entries)
    except ValueError as error:
        raise InputError(f"{path} is damaged: {error}; run its session again") from None
    texts = (about.title, about.frame, about.settings, about.session, about.versions)
    return Recorded(path, *texts, about.layout, entries, is_complete, properties)


def _checked_properties(path: Path, properties: Mapping[str, Any]) -> _Properties:
    """
    Raises:
        InputError: they are those of another program or version, or damaged.
    """
    if "schema" not in properties:
        raise InputError(f"{path} is a rerun recording of another program; expected one that view or batch wrote")
    schema = str(properties["schema"])
    if not re.fullmatch(r"[0-9]{1,9}", schema):
        raise InputError(f"{path} is damaged: its schema is {quoted(schema)}, expected {SCHEMA}; run its session again")
    if int(schema) != SCHEMA:
        when, todo = ("a later", "update") if int(schema) > SCHEMA else ("an earlier", "run its session again")
        raise InputError(
            f"{path} was written by {when} version (recording schema {schema}, this one reads {SCHEMA}); {todo}"
        )
    try:
        return _Properties.model_validate(dict(properties))
    except ValidationError as error:
        first = error.errors()[0]
        name, *where = first["loc"]
        inside = f" ({'.'.join(map(str, where))})" if where else ""
        raise InputError(
            f"{path}: its {name} cannot be read by this version: {first['msg'].splitlines()[0]}{inside};"
            " run its session again"
        ) from None


def existing(path: Path) -> Path:
    """``path``, or the unfinished recording of that name.

    Raises:
        InputError: neither exists, or it is no rerun file.
    """
    is_there = _is_file(path)
    if not is_there and path.name and (_is_file(part_path(path)) or _is_file(journal_path(path))):
        path = part_path(path)
        is_there = _is_file(path)
    has_journal = is_part(path) and _is_file(journal_path(final_path(path)))
    if has_journal and not is_there:
        return path
    with open_input(path, "recording") as file:
        head = file.read(len(_MAGIC))
    if has_journal and _MAGIC.startswith(head):
        return path
    if not head:
        raise InputError(f"{path} is empty; expected a recording (.rrd) that view or batch wrote")
    if head != _MAGIC:
        raise InputError(f"{path} is not a rerun recording; expected an .rrd file that view or batch wrote")
    return path


def _is_file(path: Path) -> bool:
    """Whether there is a file; one with an impossible name is not there."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_part(path: Path) -> bool:
    """Whether the recording was not finished."""
    return path.name.endswith(".part")


def final_path(path: Path) -> Path:
    """The name that an unfinished recording gets when it is finished."""
    return path.with_name(path.name.removesuffix(".part")) if is_part(path) else path


def has_content(path: Path) -> bool:
    """Whether there is more in the file than the beginning of a head."""
    return _is_file(path) and path.stat().st_size > len(_MAGIC)


def _read(path: Path) -> tuple[dict[str, Any], tuple[Entry, ...], bool]:
    """Properties, iterations, and whether nothing is missing; nothing at all of a part that was just begun.

    Raises:
        InputError: there is something in it that cannot be read.
    """
    if is_part(path) and not has_content(path):
        return {}, (), False
    try:
        chunks, is_whole = saved_chunks(path)
        properties, entries = _content(chunks, path)
        return properties, entries, is_whole and properties.get(COMPLETE) == str(len(entries))
    except InputError:
        # It is being written right now. The journal beside it has every iteration.
        if is_part(path) and _is_file(journal_path(final_path(path))):
            return {}, (), False
        raise


def _content(chunks: Iterable[Chunk], path: Path) -> tuple[dict[str, Any], tuple[Entry, ...]]:
    """Properties and iterations.

    Raises:
        InputError: an iteration cannot be read.
    """
    properties: dict[str, Any] = {}
    entries: list[Entry] = []
    for chunk in chunks:
        if chunk.entity_path == entities.PROPERTIES:
            for name, rows in _components(chunk):
                for row in rows:
                    if row.values:
                        properties[name] = row.values[0].as_py()
        elif chunk.entity_path == entities.LOSSLESS:
            entries += [_entry(row, path) for name, rows in _components(chunk) if name == ENTRY for row in rows]
    return properties, _without_gap(entries)


def _components(chunk: Chunk) -> Iterator[tuple[str, Any]]:
    """The components of a chunk, each a row of lists, by name without what rerun puts before it."""
    batch: Any = chunk.to_record_batch()
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        if pa.types.is_list(column.type):
            yield name.rsplit(":", 1)[-1], column


def _entry(row: Any, path: Path) -> Entry:
    """
    Raises:
        InputError: it is missing, damaged or something else.
    """
    try:
        content = row.values[0].values.to_numpy().tobytes() if row.values else b""
        bodies = unframed(content)
        if len(bodies) != 1:
            raise ValueError("its checksum does not fit it")
        return Entry.read(bodies[0])
    except (ValueError, AttributeError) as error:
        raise InputError(f"{path}: an iteration cannot be read: {error}; run its session again") from None


def _without_gap(entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """Iterations 1, 2, … as far as they are there."""
    known = {entry.iteration.index: entry for entry in entries}
    return tuple(known[k] for k in takewhile(known.__contains__, count(1)))
