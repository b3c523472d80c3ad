"""Reads recordings back: finished ones, ones whose writer was killed, and ones that were cut in the middle."""

from __future__ import annotations

import subprocess
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, Json, ValidationError
from rerun.chunk import Chunk, RrdReader

from verefine_viz.core.errors import InputError, quoted
from verefine_viz.core.input_files import open_input
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.recording import entities
from verefine_viz.recording.entry import Entry
from verefine_viz.recording.exact import entry_from
from verefine_viz.recording.journal import read_journal
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.recorder import SCHEMA
from verefine_viz.recording.rrd_messages import is_cut
from verefine_viz.recording.unfinished import journal_path, part_path
from verefine_viz.recording.viewer_process import executable

_MAGIC = b"RRF2"
PROPERTIES = f"/__properties/{entities.PROPERTY}"


@dataclass(frozen=True, eq=False)
class Recorded:
    """What a recording says, exactly."""

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
    """Whether the writer finished the file, and nothing was cut off since."""
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

    Whatever it says is checked here, so that everything that is drawn or run from it can rely on it.

    Raises:
        InputError: there is no such file, it is not a recording of this program, or it is damaged.
    """
    path = existing(path)
    properties, entries, is_whole = _read(path)
    if is_part(path):
        journal = journal_path(final_path(path))
        about, journalled = read_journal(journal) if _is_file(journal) else ({}, ())
        properties = properties or about
        entries = _without_gap((*journalled, *entries))
    checked = _checked_properties(path, properties)
    layout = checked.layout
    try:
        layout.check(entry.iteration for entry in entries)
    except ValueError as error:
        raise InputError(f"{path} is damaged: {error}; run its session again") from None
    return Recorded(
        path,
        checked.title,
        checked.frame,
        checked.settings,
        checked.session,
        checked.versions,
        layout,
        entries,
        is_whole and not is_part(path),
        properties,
    )


def _checked_properties(path: Path, properties: Mapping[str, Any]) -> _Properties:
    """
    Raises:
        InputError: they are those of another program or version, or damaged.
    """
    schema = properties.get("schema")
    if schema is None:
        raise InputError(f"{path} is a rerun recording of another program; expected one that view or batch wrote")
    if not isinstance(schema, int) or schema < 0:
        raise InputError(f"{path} is damaged: its schema is {quoted(schema)}, expected {SCHEMA}; run its session again")
    if schema != SCHEMA:
        when, todo = ("a later", "update") if schema > SCHEMA else ("an earlier", "run its session again")
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
    """The name that an unfinished recording would have got."""
    return path.with_name(path.name.removesuffix(".part")) if is_part(path) else path


def has_content(path: Path) -> bool:
    """Whether there is more in the file than the beginning of a head."""
    return _is_file(path) and path.stat().st_size > len(_MAGIC)


def chunks_of(path: Path) -> list[Chunk]:
    """All chunks of the recording (not of its blueprint) in a file that rerun is known to read."""
    with warnings.catch_warnings():
        # That the footer of a killed run is missing is what we are here for.
        warnings.simplefilter("ignore")
        return RrdReader(path).stream().to_chunks()


def saved_chunks(path: Path) -> tuple[list[Chunk], bool]:
    """The same of any file: what is left of one that is damaged or was cut off; and whether all of it could be read.

    Raises:
        InputError: nothing in it can be saved, or it ends before the message that says whose recording it is.
    """
    if _is_sound(path):
        with suppress(RuntimeError, ValueError, OSError):
            return chunks_of(path), True
    with tempfile.TemporaryDirectory() as folder:
        fixed = _repaired(path, Path(folder))
        try:
            return chunks_of(fixed), False
        except (RuntimeError, ValueError, OSError):
            raise InputError(f"{path} ended early: it holds nothing of a run; run its session again") from None


def _is_sound(path: Path) -> bool:
    """Whether rerun can decode the file. Asked of another process: bytes that make no sense abort the one that reads
    them.
    """
    return _rerun("verify", "--check-footers", "false", str(path.resolve())).returncode == 0


def _repaired(path: Path, folder: Path) -> Path:
    # The merge takes files by their suffix.
    source, fixed = folder / "cut.rrd", folder / "fixed.rrd"
    source.symlink_to(path.resolve())
    done = _rerun("merge", "--continue-on-error", str(source), "-o", str(fixed))
    if done.returncode != 0 or not fixed.is_file() or not _is_sound(fixed):
        raise InputError(f"{path} is damaged beyond repair; nothing in it can be read; run its session again")
    return fixed


def _rerun(*arguments: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([str(executable()), "rrd", *arguments], capture_output=True, check=False)


def _read(path: Path) -> tuple[dict[str, Any], tuple[Entry, ...], bool]:
    """Properties, iterations, and whether nothing was cut off; nothing at all of a part that was just begun.

    Raises:
        InputError: there is something in it that cannot be read.
    """
    if is_part(path) and not has_content(path):
        return {}, (), False
    try:
        chunks, is_whole = saved_chunks(path)
        properties, entries = _content(chunks, path)
        return properties, entries, is_whole and not is_cut(path)
    except InputError:
        # Somebody writes it right now. The journal beside it has every iteration.
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
        if chunk.entity_path == PROPERTIES:
            for row in _records(chunk):
                properties |= {name: _plain(values[0]) for name, values in row.items() if values is not None}
        elif chunk.entity_path == entities.EXACT:
            try:
                entries += map(entry_from, _records(chunk))
            except ValueError as error:
                raise InputError(f"{path}: an iteration cannot be read: {error}; run its session again") from None
    return properties, _without_gap(entries)


def _records(chunk: Chunk) -> Iterator[dict[str, Any]]:
    """The rows of a chunk by component name, without what rerun puts before a name."""
    batch = chunk.to_record_batch()
    names = [str(name) for name in batch.schema.names]
    short = [name.rsplit(":", 1)[-1] for name in names]
    columns = [batch.column(i) for i in range(len(names))]
    for k in range(batch.num_rows):
        yield {s: _value(column[k]) for s, column in zip(short, columns, strict=True)}


def _value(scalar: Any) -> Any:
    values = getattr(scalar, "values", None)
    if values is None:
        return scalar.as_py()
    if str(values.type) in ("double", "float", "int64"):
        return values.to_numpy(zero_copy_only=False)
    return values.to_pylist()


def _plain(value: Any) -> Any:
    """A number as Python's own."""
    return value.item() if isinstance(value, np.generic) else value


def _without_gap(entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """Iterations 1, 2, … as far as they are there."""
    known = {entry.iteration.index: entry for entry in entries}
    return tuple(known[k] for k in takewhile(known.__contains__, count(1)))
