"""The journal: a small file beside a recording that is being written, one entry per iteration, never rewritten.

The recording itself is made in large pieces, beside the run. Iterations reach the disk one by one here, and whoever
opens a recording whose writer was killed has them all. The journal is removed when the recording is complete.

It begins with what the recording is about (JSON). An entry is its length and its CRC-32 (4 bytes each, little-endian),
then integers (what it is about, how many stages, arms, path poses, contacts, and ids, poses and numbers of
:class:`Flat`; pixels; ids), numbers, arrays, and the texts as JSON.
"""

from __future__ import annotations

import json
import math
import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.records import Iteration
from verefine_viz.recording.row import Row, last_contacts, parts_of, pixels_of, values_of
from verefine_viz.recording.scene_parts import Flat, flat_of
from verefine_viz.recording.scene_parts import parts_of as scene_parts

MAGIC = b"VRFJ3\n"
_FRAME = struct.Struct("<II")


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
        self._write(MAGIC + _framed(json.dumps(about).encode()))

    def append(self, iteration: Iteration, errors: Float) -> None:
        """
        Args:
            iteration: what happened.
            errors: what ``Row.errors`` says.

        Raises:
            InputError: the disk does not take it.
        """
        self._write(encode(iteration, errors))

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


def encode(iteration: Iteration, errors: Float) -> bytes:
    """One entry, of which the same comes back as from :func:`row_of`.

    The run waits for this, so everything goes as it is, one after another; rows are made where they are drawn.
    """
    i, stages, best, path, choice = iteration, iteration.stages, iteration.best, iteration.path, iteration.choice
    contacts = last_contacts(iteration)
    flat = flat_of(parts_of(iteration))
    numbers: list[float] = []
    pixels: list[int] = []
    for score in (*[s.score for s in stages], best.score):
        numbers += values_of(score)
        pixels += pixels_of(score)
    numbers += [s.ms for s in stages]
    numbers.append(i.score_ms)
    arrays = [s.T_cam_obj for s in stages]
    arrays += (best.T_cam_obj, errors)
    if path is not None:
        arrays.append(path.Ts_cam_obj)
    if contacts is not None:
        arrays += (contacts.points_cam, contacts.normals_cam, contacts.depths_m, contacts.forces_n)
    if choice is not None:
        arrays += (choice.plays, choice.mean, choice.exploration, choice.ucb)
    arrays += flat.poses
    counts = (
        len(stages),
        0 if choice is None else len(choice.plays),
        0 if path is None else len(path.Ts_cam_obj),
        0 if contacts is None else len(contacts.depths_m),
        len(flat.ids),
        len(flat.poses),
        len(flat.numbers),
    )
    texts = (
        [s.name for s in stages],
        i.accepted,
        best.stage,
        "" if choice is None else choice.reason,
        [e.kind for e in i.events],
        [e.text for e in i.events],
        flat.texts,
    )
    ids = (i.index, i.instance_id, i.obj_id, i.arm, i.arm_iteration, best.arm, best.iteration)
    integers = (*ids, *counts, *pixels, *flat.ids)
    numbers += flat.numbers
    body = [struct.pack(f"<{len(integers)}q{len(numbers)}d", *integers, *numbers)]
    body += [array.tobytes() for array in arrays]
    if contacts is not None:
        body.append(contacts.others.tobytes())
    body.append(_to_json(texts).encode())
    return _framed(b"".join(body))


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
    at = 0

    def taken(dtype: str, *shape: int) -> Any:
        nonlocal at
        array = np.frombuffer(body, dtype, math.prod(shape), at).reshape(shape)
        at += array.nbytes
        return array

    index, instance_id, obj_id, arm, arm_iteration, best_arm, best_iteration, *sizes = taken("<i8", 14).tolist()
    n, n_arms, n_path, n_contacts, n_ids, n_poses, n_numbers = sizes
    pixels = taken("<i8", n + 1, 7)
    flat = Flat(ids=taken("<i8", n_ids).tolist())
    scores, ms = taken("<f8", n + 1, 3), taken("<f8", n + 1)
    flat.numbers = taken("<f8", n_numbers).tolist()
    poses, errors, path = taken("<f8", n + 1, 4, 4), taken("<f8", 3), taken("<f8", n_path, 4, 4)
    columns = [taken("<f8", n_contacts, width) for width in (3, 3, 1, 1)]
    choice = taken("<f8", 4, n_arms)
    flat.poses = list(taken("<f8", n_poses, 4, 4))
    columns.append(taken("<i8", n_contacts, 1))
    stages, accepted, best_stage, reason, kinds, texts, flat.texts = json.loads(body[at:])
    return Row(
        index=index,
        instance_id=instance_id,
        obj_id=obj_id,
        arm=arm,
        arm_iteration=arm_iteration,
        stages=tuple(stages),
        accepted=accepted,
        Ts_cam_obj=poses[:-1],
        scores=scores[:-1],
        pixels=pixels[:-1],
        best_arm=best_arm,
        best_iteration=best_iteration,
        best_stage=best_stage,
        T_best=poses[-1],
        best_score=scores[-1],
        best_pixels=pixels[-1],
        path=path.astype(np.float32),
        contacts=np.concatenate(columns, axis=1).astype(np.float32),
        choice=choice,
        reason=reason,
        event_kinds=tuple(kinds),
        event_texts=tuple(texts),
        errors=errors,
        ms=ms.astype(np.float32),
        parts=scene_parts(flat),
    )


_to_json = json.JSONEncoder(separators=(",", ":"), ensure_ascii=False).encode
