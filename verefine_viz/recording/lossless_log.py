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
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct, structs

from verefine_viz.core.arrays import Float, finite, frozen
from verefine_viz.core.errors import InputError, ShapeError, in_one_line
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.paths import read_input
from verefine_viz.core.records import Contacts, Iteration, SimulatedPath

NO_CONTACTS = Contacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
ENTRY = "entry"
"""The component of a recording that holds an iteration as bytes."""
MAGIC = b"VRFJ7\n"
"""How a journal begins; the digit is its version."""
_HEAD = struct.Struct("<II")


class Entry(Struct, frozen=True, eq=False, dict=True):
    """What the log holds of an iteration: nothing that is shown has to be computed again."""

    iteration: Iteration
    """Read back, every number is the run's, bit by bit, but for its simulated path, which is for drawing: single
    precision, and the contacts of the last step alone."""
    errors: Float
    """(3,) against ground truth: rotation [deg] and translation [mm] of the accepted pose, ADD(-S) of the best pose
    [mm]; NaN where there is no ground truth."""

    @cached_property
    def packed(self) -> bytes:
        """Both as msgpack."""
        path = self.iteration.path
        return _ENCODER.encode(Entry(structs.replace(self.iteration, path=path and _drawn(path)), self.errors))

    @staticmethod
    def read(packed: bytes) -> Entry:
        """
        Raises:
            ValueError: it is not what :attr:`packed` made.
        """
        try:
            entry = _DECODER.decode(packed)
            frozen(entry.errors, "errors", (3,))
            _check(entry.iteration)
        except (msgspec.MsgspecError, ShapeError, RecursionError) as error:
            raise ValueError(f"not an iteration: {in_one_line(str(error))}") from None
        path = entry.iteration.path
        if path is None:
            return entry
        return Entry(structs.replace(entry.iteration, path=_with_all_steps(path)), entry.errors)


def as_recorded(iteration: Iteration) -> Iteration:
    """The iteration as it is read back from a recording."""
    return Entry.read(Entry(iteration, np.zeros(3)).packed).iteration


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
        self._write(MAGIC + framed(msgspec.msgpack.encode(dict(about))))

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
        about: object = msgspec.msgpack.decode(bodies[0])
        if not isinstance(about, dict):
            raise ValueError("it does not begin with what the run is about")
        return about, tuple(map(Entry.read, bodies[1:]))
    except (ValueError, RecursionError) as error:
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


def _drawn(path: SimulatedPath) -> SimulatedPath:
    """A path as it is written: single precision, the contacts of the last step alone."""
    Ts_cam_obj: Any = path.Ts_cam_obj.astype(np.float32)
    return SimulatedPath(Ts_cam_obj, path.contacts[-1:], path.tipping)


def _with_all_steps(path: SimulatedPath) -> SimulatedPath:
    """A path as it was read, with contacts for every step, as a run has them."""
    steps = len(path.Ts_cam_obj) - 1
    contacts = (NO_CONTACTS,) * (steps - len(path.contacts)) + path.contacts
    return SimulatedPath(path.Ts_cam_obj.astype(np.float64), contacts, path.tipping)


def _packed_array(value: np.ndarray) -> list[Any]:
    """An array as its type, its shape and its bytes."""
    return [value.dtype.str, value.shape, value.tobytes()]


def _array(kind: Any, value: Any) -> np.ndarray:
    # msgspec names the field in what is raised here.
    dtype, shape, content = value
    if dtype not in _TYPES:
        raise ValueError(f"{dtype!r} is no type of an array, expected one of {', '.join(_TYPES)}")
    return np.frombuffer(content, np.dtype(dtype)).reshape(shape)


_TYPES = ("<f8", "<f4", "<i8")
"""Types of arrays: those of poses and scores, of simulated paths, of what contacts touch."""
_ENCODER = msgspec.msgpack.Encoder(enc_hook=_packed_array)
_DECODER = msgspec.msgpack.Decoder(Entry, dec_hook=_array)


def _check(iteration: Iteration) -> None:
    """Raise ShapeError where an iteration that was read holds arrays that no run makes."""
    tree, scene, choice, path = iteration.tree, iteration.scene, iteration.choice, iteration.path
    for stage in iteration.stages:
        as_rigid(stage.T_cam_obj, f"{stage.name} pose")
    as_rigid(iteration.best.T_cam_obj, "best pose")
    placed = [*iteration.placed, *(scene.poses + scene.incumbent if scene is not None else ())]
    if tree is not None:
        placed += [*tree.rollout, *tree.incumbent]
        if tree.node is not None:
            as_rigid(tree.node.T_cam_obj, f"pose of tree node {tree.node.node}")
    for pose in placed:
        as_rigid(pose.T_cam_obj, f"placed pose of instance {pose.instance_id}")
    if choice is not None:
        for name in ("plays", "mean", "exploration", "ucb"):
            frozen(getattr(choice, name), name, (None,))
    if path is not None:
        finite(path.Ts_cam_obj, "simulated path", (None, 4, 4))
        for contacts in path.contacts:
            n = len(contacts.depths_m)
            finite(contacts.points_cam, "contact points", (n, 3))
            finite(contacts.normals_cam, "contact normals", (n, 3))
            finite(contacts.forces_n, "contact forces", (n,))
            frozen(contacts.others, "contact partners", (n,), np.int64)
