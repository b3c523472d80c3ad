"""The file of a recording: its name while it is written, writing it through rerun, and what rerun can read of it.

Rerun encodes what is sent; the bytes are written here and not by rerun's own file sink, which waits for ever where a
disk is full (0.41: its writing thread ends, and the flush that follows is never answered).
"""

from __future__ import annotations

import os
import struct
import subprocess
import tempfile
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
import rerun_cli
from rerun.chunk import Chunk, RrdReader

from verefine_viz.core.errors import InputError, UnavailableError
from verefine_viz.recording import entities

COMPLETE = "complete"
"""The last property of a finished recording: how many iterations it holds."""


def part_path(path: Path) -> Path:
    """Where a recording lies while it is written."""
    return path.with_name(path.name + ".part")


def journal_path(path: Path) -> Path:
    """The journal beside a recording that is being written."""
    return path.with_name(path.name + ".journal")


class RecordingFile:
    """Writes a recording to a file."""

    def __init__(self, path: Path) -> None:
        """Creates the file; what is there is replaced.

        Raises:
            InputError: it cannot be written.
        """
        self._path = path
        self._error: OSError | None = None
        self._stream = rr.RecordingStream(entities.APPLICATION, send_properties=False)
        # The same run makes the same recording.
        self._stream.set_log_time_enabled(False)
        self._encoded = self._stream.binary_stream()
        try:
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise InputError(f"cannot write the recording {path}: {error.strerror}") from None

    def send_properties(self, values: Mapping[str, str], name: str = "") -> None:
        """What the recording is about, and what viewers call it; in the file when this returns."""
        texts = [rr.components.TextBatch([text]).described(rr.ComponentDescriptor(n)) for n, text in values.items()]
        self._stream.send_property(entities.PROPERTY, texts)
        if name:
            self._stream.send_recording_name(name)
        self.flush()

    def send_blueprint(self, blueprint: rrb.Blueprint) -> None:
        """How the recording looks when it is opened."""
        self._stream.send_blueprint(blueprint)

    def log(self, entity: str, *archetypes: rr.AsComponents) -> None:
        """What does not change over the iterations."""
        self._stream.log(entity, *archetypes, static=True, strict=True)

    def send(
        self,
        entity: str,
        iterations: Sequence[int],
        *columns: Iterable[rr.ComponentColumn],
        timeline: str = entities.TIMELINE,
    ) -> None:
        """One row of ``entity`` for each of the iterations, or whatever the timeline counts."""
        times = rr.TimeColumn(timeline, sequence=iterations)
        self._stream.send_columns(entity, [times], [c for some in columns for c in some], strict=True)

    def log_at(self, timeline: str, moment: int, entity: str, *archetypes: rr.AsComponents) -> None:
        """What is so from a place of another timeline on."""
        self._stream.set_time(timeline, sequence=moment)
        self._stream.log(entity, *archetypes, strict=True)
        self._stream.reset_time()

    def send_chunks(self, chunks: Sequence[Chunk]) -> None:
        """What was read from another recording."""
        self._stream.send_chunks(chunks)

    def flush(self) -> None:
        """Writes all that was sent; it is with the operating system when this returns.

        Raises:
            InputError: the disk does not take it, or did not take what came before.
        """
        content = self._encoded.read() or b""
        messages = memoryview(content)[_HEAD_SIZE : _end_of_messages(content)]
        try:
            if self._error is not None:
                raise self._error
            if self._file.tell() == 0:
                self._write(memoryview(content)[:_HEAD_SIZE])
            self._write(messages)
        except OSError as error:
            self._error = error
            raise InputError(f"cannot write the recording {self._path}: {error.strerror}") from None

    def close(self, n_iterations: int) -> None:
        """Finishes the file: what it says last is how many iterations it holds, so that a missing end is noticed.

        Raises:
            InputError: the disk did not take all of it.
        """
        try:
            self.flush()
            self.send_properties({COMPLETE: str(n_iterations)})
        finally:
            self._stream.disconnect()
            self._file.close()

    def _write(self, content: memoryview) -> None:
        # A disk that is nearly full takes a part, and refuses when it is asked again.
        while content:
            content = content[self._file.write(content) :]


_HEAD_SIZE = 12
_MESSAGE = struct.Struct("<QQ")
_FOOTER = 0


def _end_of_messages(stream: bytes) -> int:
    """Where the messages of an encoded stream end: each is its kind and length, then its content.

    What follows is an index of this part of the stream, which would be wrong in a file of several.
    """
    at = _HEAD_SIZE
    while at + _MESSAGE.size <= len(stream):
        kind, length = _MESSAGE.unpack_from(stream, at)
        if kind == _FOOTER:
            break
        at += _MESSAGE.size + length
    return at


def chunks_of(path: Path) -> list[Chunk]:
    """All chunks of the recording (not of its blueprint) in a file that rerun is known to read."""
    with warnings.catch_warnings(action="ignore"):  # That a file has no index.
        return RrdReader(path).stream().to_chunks()


def saved_chunks(path: Path) -> tuple[list[Chunk], bool]:
    """The same of any file: what is left of one that is damaged or truncated; and whether all of it could be read.

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
    source, fixed = folder / "truncated.rrd", folder / "fixed.rrd"
    source.symlink_to(path.resolve())
    done = _rerun("merge", "--continue-on-error", str(source), "-o", str(fixed))
    if done.returncode != 0 or not fixed.is_file() or not _is_sound(fixed):
        raise InputError(f"{path} is damaged beyond repair; nothing in it can be read; run its session again")
    return fixed


def _rerun(*arguments: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([str(executable()), "rrd", *arguments], capture_output=True, check=False)


def executable() -> Path:
    """The viewer that the rerun package brings along.

    Raises:
        UnavailableError: it is not there.
    """
    # The console script only starts this one as a child, which would outlive it.
    path = Path(rerun_cli.__file__).parent / ("rerun.exe" if os.name == "nt" else "rerun")
    if not path.exists():
        raise UnavailableError(f"the rerun viewer is not installed ({path} is missing); pip install rerun-sdk")
    return path
