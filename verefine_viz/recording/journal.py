"""The journal: a small file beside a recording that is being written, one entry per iteration, never rewritten.

The recording itself is made in large pieces, beside the run. Iterations reach the disk one by one here, and whoever
opens a recording whose writer was killed has them all. The journal is removed when the recording is complete.

It begins with what the recording is about (JSON). An entry is its length and its CRC-32 (4 bytes each, little-endian),
then the counts of what follows, then the arrays, then the texts as JSON.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from verefine_viz.core.errors import InputError
from verefine_viz.recording.row import Row
from verefine_viz.recording.scene_parts import Flat, flat_of, parts_of

MAGIC = b"VRFJ2\n"
_FRAME = struct.Struct("<II")
_COUNTS = struct.Struct("<14q")
"""index, instance, object, arm, its iteration, arm and iteration of the best; then how many stages, arms, path poses,
contacts, and how many ids, poses and numbers of :class:`Flat`."""


class Journal:
    """Appends rows; each is with the operating system when :meth:`append` returns."""

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        """
        Raises:
            OSError: the file cannot be created.
            InputError: the disk does not take its beginning.
        """
        self._path = path
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._write(MAGIC + _framed(json.dumps(about).encode()))

    def append(self, row: Row) -> None:
        """
        Raises:
            InputError: the disk does not take it.
        """
        self._write(encode(row))

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


def encode(row: Row) -> bytes:
    """One entry."""
    flat = flat_of(row.parts)
    counts = _COUNTS.pack(
        row.index,
        row.instance_id,
        row.obj_id,
        row.arm,
        row.arm_iteration,
        row.best_arm,
        row.best_iteration,
        len(row.stages),
        row.choice.shape[1],
        len(row.path),
        len(row.contacts),
        len(flat.ids),
        len(flat.poses),
        len(flat.numbers),
    )
    texts = (row.stages, row.accepted, row.best_stage, row.reason, row.event_kinds, row.event_texts, flat.texts)
    arrays = [getattr(row, name).tobytes() for name, _, _ in _ARRAYS]
    if flat.ids:
        arrays += [np.array(flat.ids, "<i8").tobytes(), *(T.tobytes() for T in flat.poses)]
        arrays.append(np.array(flat.numbers, "<f8").tobytes())
    return _framed(b"".join((counts, *arrays, _to_json(texts).encode())))


def read_journal(path: Path) -> tuple[dict[str, Any], tuple[Row, ...]]:
    """What the journal is about and all its whole entries.

    What was cut off in the middle of the last entry is left out; nothing is known of a file that is no journal.
    """
    content = path.read_bytes()
    found = _whole_entries(content) if content.startswith(MAGIC) else []
    about, *entries = found or [b"{}"]
    return json.loads(about), tuple(map(_decode, entries))


def _framed(body: bytes) -> bytes:
    return _FRAME.pack(len(body), zlib.crc32(body)) + body


def _whole_entries(content: bytes) -> list[bytes]:
    found: list[bytes] = []
    at = len(MAGIC)
    while at + _FRAME.size <= len(content):
        length, crc = _FRAME.unpack_from(content, at)
        body = content[at + _FRAME.size : at + _FRAME.size + length]
        if len(body) < length or zlib.crc32(body) != crc:
            break
        found.append(body)
        at += _FRAME.size + length
    return found


def _decode(body: bytes) -> Row:
    index, instance_id, obj_id, arm, arm_iteration, best_arm, best_iteration, *sizes = _COUNTS.unpack_from(body)
    n_stages, n_arms, n_path, n_contacts, n_ids, n_poses, n_numbers = sizes
    known = {"n": n_stages, "n+1": n_stages + 1, "h": n_arms, "p": n_path, "k": n_contacts}
    at = _COUNTS.size

    def taken(dtype: str, *shape: int) -> Any:
        nonlocal at
        count = int(np.prod(shape, dtype=int))
        array = np.frombuffer(body, dtype, count, at).reshape(shape)
        at += array.nbytes
        return array

    arrays = {name: taken(dtype, *(known.get(str(s), s) for s in shape)) for name, dtype, shape in _ARRAYS}
    flat = Flat()
    if n_ids:
        flat.ids = taken("<i8", n_ids).tolist()
        flat.poses = list(taken("<f8", n_poses, 4, 4))
        flat.numbers = taken("<f8", n_numbers).tolist()
    stages, accepted, best_stage, reason, kinds, texts, flat.texts = json.loads(body[at:])
    return Row(
        index=index,
        instance_id=instance_id,
        obj_id=obj_id,
        arm=arm,
        arm_iteration=arm_iteration,
        stages=tuple(stages),
        accepted=accepted,
        best_arm=best_arm,
        best_iteration=best_iteration,
        best_stage=best_stage,
        reason=reason,
        event_kinds=tuple(kinds),
        event_texts=tuple(texts),
        parts=parts_of(flat),
        **arrays,
    )


_to_json = json.JSONEncoder(separators=(",", ":"), ensure_ascii=False).encode
_ARRAYS: tuple[tuple[str, str, tuple[Any, ...]], ...] = (
    ("Ts_cam_obj", "<f8", ("n", 4, 4)),
    ("scores", "<f8", ("n", 3)),
    ("pixels", "<i8", ("n", 7)),
    ("T_best", "<f8", (4, 4)),
    ("best_score", "<f8", (3,)),
    ("best_pixels", "<i8", (7,)),
    ("path", "<f4", ("p", 4, 4)),
    ("contacts", "<f4", ("k", 9)),
    ("choice", "<f8", (4, "h")),
    ("errors", "<f8", (3,)),
    ("ms", "<f4", ("n+1",)),
)
"""Field of :class:`Row`, type, shape."""
