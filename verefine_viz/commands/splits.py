"""Which splits a data set's folder holds, and what somebody meant who named another folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from verefine_viz.core.errors import InputError
from verefine_viz.core.listing import MOST_NAMED, first_of


def splits_of(folder: Path) -> tuple[str, ...]:
    """The folders in a data set that hold scenes.

    Raises:
        InputError: the folder does not exist, or holds none.
    """
    if not folder.is_dir():
        why = "is a file" if folder.exists() else "does not exist"
        raise InputError(f"{folder} {why}; give the folder that holds models/ and the splits (test/, …)")
    found = _splits(folder)
    if not found:
        raise InputError(f"{folder} holds no split with scenes; {_meant(folder)}")
    return tuple(found)


def _splits(folder: Path) -> list[str]:
    return [d.name for d in sorted(folder.iterdir()) if d.is_dir() and any(_scene_folders(d))]


def _meant(folder: Path) -> str:
    """Which folder a person may have meant who named one without splits."""
    if any(_scene_folders(folder)):
        return f"it is a split itself: name the data set's folder, {folder.resolve().parent}"
    inside = [d for d in sorted(folder.iterdir()) if d.is_dir() and _splits(d)]
    if inside:
        return f"did you mean {first_of(inside, MOST_NAMED, ' or ')}?"
    return f"expected for example {folder / 'test' / '000001'}"


def _scene_folders(split: Path) -> Iterator[Path]:
    return (d for d in split.iterdir() if d.is_dir() and d.name.isdecimal())
