"""The labels of a folder of frames while they are made: held by one program, on the disk as soon as they are made.

``labels.json`` is replaced as a whole with each change, so that a killed program loses at most the label in hand. A
lock file beside it names the program that holds it.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import BinaryIO

from msgspec import Struct, json, structs

from verefine_viz.core.errors import InputError, one_line
from verefine_viz.core.files import decoded_json, read_file
from verefine_viz.core.writing import check_folder, clear_parts, make_inside, try_lock
from verefine_viz.scenes.labels import LABELS, Label, read_labels, write_labels

LOCK = ".labels.lock"
MOST_LOCK_BYTES = 10_000


class Holder(Struct, frozen=True):
    """Holder of a folder's labels, as its lock file names it."""

    pid: int
    host: str
    since: str
    """As 2026-01-31T12:00:00."""


def folder_of_labels(frames: Path) -> Path:
    """Folder for the labels of a folder of frames: itself, or ``NAME-labels`` beside it where it cannot be written to.

    Raises:
        InputError: nothing can be written in either place.
    """
    try:
        check_folder(frames)
    except InputError:
        beside = frames.absolute().with_name(f"{frames.absolute().name}-labels")
        check_folder(beside)
        return beside
    return frames


class LabelFolder:
    """The labels of a folder, until it is closed.

    Args:
        folder: where ``labels.json`` is, or will be; is made.

    Raises:
        InputError: another program holds it, the file is damaged, or nothing can be written there.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / LABELS
        make_inside(folder)
        self._lock = _taken(folder)
        try:
            clear_parts(folder, LABELS)
            self._frames = read_labels(self.path)
        except BaseException:
            self._lock.close()
            raise
        self._last = {frame: max((one.instance for one in of), default=-1) for frame, of in self._frames.items()}

    @property
    def frames(self) -> Mapping[str, tuple[Label, ...]]:
        """All labels by frame; a frame with an empty entry was labelled as holding nothing."""
        return MappingProxyType(self._frames)

    def labels(self, frame: str) -> tuple[Label, ...]:
        """The labels of a frame, in the order of their numbers."""
        return self._frames.get(frame, ())

    def next_instance(self, frame: str) -> int:
        """A number that no object of the frame has, or has had since the folder was opened."""
        return self._last.get(frame, -1) + 1

    def put(self, frame: str, label: Label) -> None:
        """Write a label, in place of the one of the same instance where there is one.

        Raises:
            InputError: it cannot be written; all is as before.
        """
        others = [one for one in self.labels(frame) if one.instance != label.instance]
        self._write(frame, tuple(sorted([*others, label], key=lambda one: one.instance)))
        self._last[frame] = max(self._last.get(frame, -1), label.instance)

    def remove(self, frame: str, instance: int) -> None:
        """Remove a label; a frame that has none left counts as not labelled.

        Raises:
            InputError: there is none, or the file cannot be written; all is as before.
        """
        others = tuple(one for one in self.labels(frame) if one.instance != instance)
        if len(others) == len(self.labels(frame)):
            raise InputError(f"frame {frame} has no label of instance {instance}")
        self._write(frame, others or None)

    def replace_all(self, frame: str, labels: Sequence[Label] | None) -> None:
        """Write the labels of a frame in place of those it has; None = the frame counts as not labelled.

        Raises:
            InputError: they cannot be written; all is as before.
        """
        self._write(frame, None if labels is None else tuple(sorted(labels, key=lambda one: one.instance)))
        last = max((one.instance for one in labels or ()), default=-1)
        self._last[frame] = max(self._last.get(frame, -1), last)

    def mark_empty(self, frame: str, is_empty: bool = True) -> None:
        """Record that a frame without labels holds nothing, or take that back.

        Raises:
            InputError: it has labels, or the file cannot be written; all is as before.
        """
        if self.labels(frame):
            raise InputError(f"frame {frame} has {len(self.labels(frame))} labels; remove them first")
        self._write(frame, () if is_empty else None)

    def close(self) -> None:
        """Let other programs hold the folder."""
        self._lock.close()

    def __enter__(self) -> LabelFolder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _write(self, frame: str, labels: tuple[Label, ...] | None) -> None:
        changed = {name: of for name, of in self._frames.items() if name != frame}
        if labels is not None:
            changed[frame] = labels
        write_labels(self.path, changed)
        self._frames = changed


def _taken(folder: Path) -> BinaryIO:
    """Take the lock and write this program's name into it."""
    lock = try_lock(folder / LOCK)
    if lock is None:
        raise InputError(f"{folder} is being labelled {_holder(folder)}; close that one, or label another folder")
    holder = Holder(os.getpid(), platform.node(), datetime.now().astimezone().isoformat(timespec="seconds"))
    lock.truncate(0)
    lock.write(json.encode(structs.asdict(holder)))
    lock.flush()
    return lock


def _holder(folder: Path) -> str:
    try:
        holder = decoded_json(read_file(folder / LOCK, most_bytes=MOST_LOCK_BYTES), Holder)
    except (InputError, ValueError):  # The file is just being written.
        return "by another program"
    return one_line(f"by process {holder.pid} on {holder.host} since {holder.since}")
