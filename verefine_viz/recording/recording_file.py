"""The file of a recording: writing it through rerun, and what rerun reads of it.

Rerun encodes what is sent; the bytes are written here and not by rerun's own file sink, which waits for ever where a
disk is full (0.41: its writing thread ends, and the flush that follows is never answered).
"""

from __future__ import annotations

import os
import struct
import subprocess
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
import rerun_cli
from rerun.chunk import Chunk, RrdReader

from verefine_viz.core.errors import InputError, UnavailableError
from verefine_viz.core.writing import new_file
from verefine_viz.recording import entities

CONTENT = "content"
"""The component that holds a file."""


class RecordingFile:
    """Writes a recording to a file."""

    def __init__(self, path: Path, recording_id: str | None = None) -> None:
        """Creates the file; what is there is replaced.

        ``recording_id``: a viewer takes files of the same for one recording; None = one of its own.

        Raises:
            InputError: it cannot be written.
        """
        self._path = path
        self._file = os.fdopen(new_file(path), "wb", buffering=0)
        self._error: OSError | None = None
        self._stream = rr.RecordingStream(entities.APPLICATION, recording_id=recording_id, send_properties=False)
        # The same run makes the same recording.
        self._stream.set_log_time_enabled(False)
        self._encoded = self._stream.binary_stream()

    def send_properties(self, values: Mapping[str, str | Sequence[str] | Sequence[float]], name: str = "") -> None:
        """What the recording is about, and what viewers call it; in the file when this returns. More may follow."""
        listed = {name: [value] if isinstance(value, str) else value for name, value in values.items()}
        self._stream.send_property(entities.PROPERTY, rr.AnyValues(drop_untyped_nones=True, **listed))
        if name:
            self._stream.send_recording_name(name)
        self.flush()

    def send_blueprint(self, blueprint: rrb.Blueprint) -> None:
        """How the recording looks when it is opened."""
        self._stream.send_blueprint(blueprint)

    def log_bytes(self, entity: str, content: bytes) -> None:
        """Log a file as it is, as component :data:`CONTENT`."""
        blob = rr.components.BlobBatch([content]).described(rr.ComponentDescriptor(CONTENT))
        self._stream.log(entity, [blob], static=True, strict=True)

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

    def close(self) -> None:
        """Finishes the file.

        Raises:
            InputError: the disk did not take all of it.
        """
        try:
            self.flush()
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


def is_whole(path: Path) -> bool:
    """Whether rerun can read all of a recording, or of what a killed program wrote of it."""
    return _rerun("verify", "--check-footers", "false", str(path.resolve())).returncode == 0


def read_bytes(path: Path, entity: str) -> bytes | None:
    """What :meth:`RecordingFile.log_bytes` logged; None where it is not there, as in a recording that was cut off."""
    # Asked of another process first: bytes that make no sense abort the one that reads them.
    if not is_whole(path):
        return None
    with suppress(RuntimeError, ValueError, OSError):
        for chunk in chunks_of(path):
            if chunk.entity_path == entity:
                batch = chunk.to_record_batch()
                column = next(c for name, c in zip(batch.schema.names, batch.columns, strict=True) if CONTENT in name)
                return column[0].values[0].values.to_numpy().tobytes()
    return None


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
