"""The lossless log: every iteration bit by bit, in the recording and, while that is written, in a journal beside it.

An iteration is msgpack, field by field as in ``core.records``, after its length and its CRC-32 (4 bytes each,
little-endian). The journal is a small file that gets one entry per iteration and is never rewritten: drawing waits for
several iterations, the journal has each of them when the run goes on, so that a recording whose writer was killed has
all of them. It begins with what the recording is about, and is removed when the recording is complete.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_origin

import cattrs
import numpy as np
import ormsgpack

from verefine_viz.core.arrays import Float, frozen
from verefine_viz.core.errors import InputError, ShapeError, in_one_line
from verefine_viz.core.paths import read_input
from verefine_viz.core.records import Contacts, Iteration, SimulatedPath, Tipping

NO_CONTACTS = Contacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
ENTRY = "entry"
"""The component of a recording that holds an iteration as bytes."""
MAGIC = b"VRFJ6\n"
"""How a journal begins; the digit is its version."""
_HEAD = struct.Struct("<II")


@dataclass(frozen=True, eq=False)
class Entry:
    """What the log holds of an iteration: nothing that is shown has to be computed again."""

    iteration: Iteration
    """Read back, every number is the run's, bit by bit, but for its simulated path, which is for drawing: single
    precision, and the contacts of the last step alone."""
    errors: Float
    """(3,) against ground truth: rotation [deg] and translation [mm] of the accepted pose, ADD(-S) of the best pose
    [mm]; NaN where there is no ground truth."""
    packed: bytes
    """Both as msgpack."""

    @staticmethod
    def of(iteration: Iteration, errors: Float) -> Entry:
        """What the recorder does between two iterations: the run waits for it."""
        values = {**vars(iteration), "path": None if iteration.path is None else _drawn_path(iteration.path)}
        packed = ormsgpack.packb((values, errors), np.ndarray.tolist, ormsgpack.OPT_SERIALIZE_NUMPY)
        return Entry(iteration, errors, packed)

    @staticmethod
    def read(packed: bytes) -> Entry:
        """
        Raises:
            ValueError: it is not what :meth:`of` made.
        """
        try:
            values, errors = ormsgpack.unpackb(packed)
            return Entry(_converter().structure(values, Iteration), frozen(errors, "errors", (3,)), packed)
        except cattrs.BaseValidationError as error:
            raise ValueError(f"not an iteration: {in_one_line(cattrs.transform_error(error)[0])}") from None
        except (TypeError, KeyError, ShapeError) as error:
            raise ValueError(f"not an iteration: {error}") from None


def as_recorded(iteration: Iteration) -> Iteration:
    """The iteration as it is read back from a recording."""
    return Entry.read(Entry.of(iteration, np.zeros(3)).packed).iteration


class Journal:
    """Appends iterations; each is with the operating system when :meth:`append` returns."""

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        """
        Raises:
            OSError: the file cannot be created.
            InputError: the disk does not take its beginning.
        """
        self._path = path
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._write(MAGIC + framed(ormsgpack.packb(dict(about))))

    def append(self, entry: Entry) -> None:
        """
        Raises:
            InputError: the disk does not take it.
        """
        self._write(framed(entry.packed))

    def close(self) -> None:
        """Later calls do nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _write(self, content: bytes) -> None:
        try:
            # A disk that is nearly full takes a part, and refuses when it is asked again.
            while content:
                content = content[os.write(self._file, content) :]
        except OSError as error:
            raise InputError(f"cannot write {self._path}: {error.strerror or error}") from None


def read_journal(path: Path) -> tuple[dict[str, Any], tuple[Entry, ...]]:
    """What the journal is about and all its whole entries.

    An entry that was truncated is left out; of a file that is no journal nothing is read.

    Raises:
        InputError: it cannot be read, is of another version, or holds something else than iterations.
    """
    content = read_input(path, "journal")
    if content[:4] == MAGIC[:4] and not content.startswith(MAGIC):
        raise InputError(f"journal {path} was written by another version; run its session again")
    bodies = unframed(content[len(MAGIC) :]) if content.startswith(MAGIC) else []
    if not bodies:
        return {}, ()
    try:
        about: object = ormsgpack.unpackb(bodies[0])
        if not isinstance(about, dict):
            raise ValueError("it does not begin with what the run is about")
        return about, tuple(map(Entry.read, bodies[1:]))
    except ValueError as error:
        raise InputError(f"journal {path} is damaged: {error}; run its session again") from None


def framed(body: bytes) -> bytes:
    """A body with its length and checksum before it."""
    return _HEAD.pack(len(body), zlib.crc32(body)) + body


def unframed(content: bytes) -> list[bytes]:
    """The bodies that follow one another, up to the first that is not whole."""
    bodies: list[bytes] = []
    at = 0
    while at + _HEAD.size <= len(content):
        length, crc = _HEAD.unpack_from(content, at)
        body = content[at + _HEAD.size : at + _HEAD.size + length]
        if len(body) < length or zlib.crc32(body) != crc:
            break
        bodies.append(body)
        at += _HEAD.size + length
    return bodies


def _drawn_path(path: SimulatedPath) -> dict[str, Any]:
    Ts = path.Ts_cam_obj.astype(np.float32)
    return {"Ts_cam_obj": Ts, "contacts": path.contacts[-1:], "tipping": path.tipping}


@cache
def _converter() -> cattrs.Converter:
    """From plain values to records."""
    converter = cattrs.Converter()
    converter.register_structure_hook_func(lambda kind: get_origin(kind) is np.ndarray, _array)
    converter.register_structure_hook(Contacts, _contacts)
    converter.register_structure_hook(SimulatedPath, _path)
    return converter


def _array(values: Any, kind: Any) -> np.ndarray:
    """As its annotation says: ``NDArray[np.float64]`` is an array of any shape and of that type."""
    _, dtype = get_args(kind)
    return np.array(values, get_args(dtype)[0])


def _path(values: Mapping[str, Any], _: Any) -> SimulatedPath:
    """With contacts for every step, as a run has them."""
    poses, last = values["Ts_cam_obj"], [_contacts(contacts, Contacts) for contacts in values["contacts"]]
    contacts = (NO_CONTACTS,) * (len(poses) - 1 - len(last)) + tuple(last)
    tipping = values.get("tipping")
    return SimulatedPath(np.array(poses), contacts, None if tipping is None else Tipping(**tipping))


def _contacts(values: Mapping[str, Any], _: Any) -> Contacts:
    """Plain values do not say how wide an empty array is."""
    return Contacts(
        np.reshape(values["points_cam"], (-1, 3)),
        np.reshape(values["normals_cam"], (-1, 3)),
        values["depths_m"],
        values["forces_n"],
        values["others"],
    )
