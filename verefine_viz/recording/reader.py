"""Reads recordings back: finished ones, ones whose writer was killed, and ones that were cut in the middle."""

from __future__ import annotations

import json
import subprocess
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import pydantic
from rerun.chunk import Chunk, RrdReader

from verefine_viz.core.errors import InputError
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.recording import entities
from verefine_viz.recording.entry import Entry
from verefine_viz.recording.exact import entry_from
from verefine_viz.recording.journal import read_journal
from verefine_viz.recording.layout import Layout, layout_from_json
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


def read_recording(path: Path) -> Recorded:
    """The recording at ``path``; that of a run still going on or killed is found by its final name as well.

    Raises:
        InputError: there is no such file, or it is not a recording of this program.
    """
    path = existing(path)
    properties, entries, is_whole = _read(path)
    if is_part(path):
        journal = journal_path(final_path(path))
        about, journalled = read_journal(journal) if journal.is_file() else ({}, ())
        properties = properties or about
        entries = _without_gap((*journalled, *entries))
    if "schema" not in properties:
        raise InputError(f"{path} is a rerun recording of another program; expected one that view or batch wrote")
    schema = int(properties["schema"])
    if schema != SCHEMA:
        when, todo = ("a later", "update") if schema > SCHEMA else ("an earlier", "run its session again")
        raise InputError(
            f"{path} was written by {when} version (recording schema {schema}, this one reads {SCHEMA}); {todo}"
        )
    try:
        session = Session.model_validate_json(properties["settings"])
        layout = layout_from_json(properties["layout"])
        versions = json.loads(properties["versions"])
    except (KeyError, TypeError, pydantic.ValidationError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: its settings cannot be read by this version: {str(error).splitlines()[0]}") from None
    return Recorded(
        path,
        properties["title"],
        properties["frame"],
        session,
        properties["session"],
        versions,
        layout,
        entries,
        is_whole and not is_part(path),
        properties,
    )


def existing(path: Path) -> Path:
    """``path``, or the unfinished recording of that name.

    Raises:
        InputError: neither exists, or it is no rerun file.
    """
    if not path.is_file() and (part_path(path).is_file() or journal_path(path).is_file()):
        path = part_path(path)
    try:
        with path.open("rb") as file:
            head = file.read(len(_MAGIC))
    except FileNotFoundError:
        if is_part(path) and journal_path(final_path(path)).is_file():
            return path
        raise InputError(f"recording {path} does not exist") from None
    except OSError as error:
        raise InputError(f"recording {path} cannot be read: {error.strerror}") from None
    if is_part(path) and journal_path(final_path(path)).is_file() and _MAGIC.startswith(head):
        return path
    if not head:
        raise InputError(f"{path} is empty; expected a recording (.rrd) that view or batch wrote")
    if head != _MAGIC:
        raise InputError(f"{path} is not a rerun recording; expected an .rrd file that view or batch wrote")
    return path


def is_part(path: Path) -> bool:
    """Whether the recording was not finished."""
    return path.name.endswith(".part")


def final_path(path: Path) -> Path:
    """The name that an unfinished recording would have got."""
    return path.with_name(path.name.removesuffix(".part")) if is_part(path) else path


def has_content(path: Path) -> bool:
    """Whether there is more in the file than the beginning of a head."""
    return path.is_file() and path.stat().st_size > len(_MAGIC)


@contextmanager
def readable(path: Path) -> Iterator[Path]:
    """The file itself, or a repaired temporary copy where it ends in the middle of a message.

    Raises:
        InputError: nothing in it can be saved.
    """
    try:
        chunks_of(path)
    except (RuntimeError, ValueError, OSError):
        with tempfile.TemporaryDirectory() as folder:
            yield _repaired(path, Path(folder))
        return
    yield path


def _repaired(path: Path, folder: Path) -> Path:
    # The merge takes files by their suffix.
    source, fixed = folder / "cut.rrd", folder / "fixed.rrd"
    source.symlink_to(path.resolve())
    command = [str(executable()), "rrd", "merge", "--continue-on-error", str(source), "-o", str(fixed)]
    done = subprocess.run(command, capture_output=True, check=False, timeout=600)
    if done.returncode != 0 or not fixed.is_file():
        raise InputError(f"{path} is damaged beyond repair; nothing in it can be read")
    return fixed


def chunks_of(path: Path) -> list[Chunk]:
    """All chunks of the recording (not of its blueprint) in a readable file."""
    with warnings.catch_warnings():
        # That the footer of a killed run is missing is what we are here for.
        warnings.simplefilter("ignore")
        return RrdReader(path).stream().to_chunks()


def _read(path: Path) -> tuple[dict[str, Any], tuple[Entry, ...], bool]:
    """Properties, iterations, and whether nothing was cut off; nothing at all of a part that was just begun.

    Raises:
        InputError: there is something in it that cannot be read.
    """
    if is_part(path) and not has_content(path):
        return {}, (), False
    try:
        with readable(path) as file:
            properties, entries = _content(file, path)
            return properties, entries, file == path and not is_cut(path)
    except InputError:
        # Somebody writes it right now. The journal beside it has every iteration.
        if is_part(path) and journal_path(final_path(path)).is_file():
            return {}, (), False
        raise


def _content(file: Path, path: Path) -> tuple[dict[str, Any], tuple[Entry, ...]]:
    """Properties and iterations of a readable file.

    Raises:
        InputError: nothing was written yet, or an iteration cannot be read.
    """
    properties: dict[str, Any] = {}
    entries: list[Entry] = []
    try:
        for chunk in _begun_chunks(file, path):
            if chunk.entity_path == PROPERTIES:
                properties |= {name: values[0] for name, values in next(_records(chunk)).items()}
            elif chunk.entity_path == entities.EXACT:
                entries += map(entry_from, _records(chunk))
    except (RuntimeError, OSError) as error:
        raise InputError(f"{path} cannot be read: {str(error).splitlines()[0]}") from None
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise InputError(f"{path}: an iteration cannot be read ({type(error).__name__}: {error})") from None
    return properties, _without_gap(entries)


def _begun_chunks(file: Path, path: Path) -> list[Chunk]:
    """
    Raises:
        InputError: the file ends before the message that says whose recording it is.
    """
    try:
        return chunks_of(file)
    except ValueError:
        raise InputError(f"{path} ended early: it holds nothing of a run; run its session again") from None


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


def _without_gap(entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """Iterations 1, 2, … as far as they are there."""
    known = {entry.iteration.index: entry for entry in entries}
    return tuple(known[k] for k in takewhile(known.__contains__, count(1)))
