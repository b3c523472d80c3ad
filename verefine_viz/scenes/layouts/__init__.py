"""Readers of folders as other programs have them, one layout a file: each module here has a class ``Reader``."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from itertools import islice
from pathlib import Path
from pkgutil import iter_modules

from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.scenes.recorded_frame import LayoutReader

MOST_LOOKED_AT = 1000
"""Folders in which what was meant is looked for."""


@cache
def readers() -> tuple[type[LayoutReader], ...]:
    """All of them, by listing this folder."""
    return tuple(import_module(f"{__name__}.{module.name}").Reader for module in iter_modules(__path__))


def recording_in(folder: Path) -> LayoutReader | None:
    """What a folder holds in one of the layouts, None where it has none of them.

    Raises:
        InputError: what all its frames share is missing or damaged.
    """
    reader = next((reader for reader in readers() if reader.recognizes(folder)), None)
    return None if reader is None else reader(folder)


def lacking(folder: Path) -> str:
    """What a folder lacks that is not recognized but has all files of a layout, or all but one; else empty.

    Of several layouts it is the one of which most files are there.
    """
    nearest: tuple[int, str] = (0, "")
    for reader in readers():
        missing = [(name, what) for name, what in reader.NEEDS if not (folder / name).exists()]
        n_there = len(reader.NEEDS) - len(missing)
        if len(missing) > 1 or n_there <= nearest[0]:
            continue
        lacks = (
            f"{missing[0][0]} is missing: {missing[0][1]}" if missing else f"is named otherwise: {reader.LOOKS_LIKE}"
        )
        nearest = n_there, f"looks like the {reader.LAYOUT}, but {lacks}"
    return nearest[1]


def recordings_near(folder: Path) -> str:
    """The folders around a folder, or up to two below it, that hold a recording, as "a or b"; empty where none does."""
    for pattern in ("*", "*/*"):
        folders = islice((path for path in sorted(folder.glob(pattern)) if path.is_dir()), MOST_LOOKED_AT)
        below = [path for path in folders if _is_recognized(path)]
        if not below:
            continue
        around = folder.resolve().parent
        are_parts = any(reader.recognizes(around) and reader.recognizes(below[0]) for reader in readers())
        return str(around) if are_parts else first_of(below, MOST_NAMED, " or ")
    return ""


def _is_recognized(folder: Path) -> bool:
    try:
        return any(reader.recognizes(folder) for reader in readers())
    except OSError:  # It may not be looked into.
        return False
