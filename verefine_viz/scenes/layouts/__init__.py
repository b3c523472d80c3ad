"""Readers of folders as other programs have them, one layout a file: each module here has a class ``Reader``."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from verefine_viz.scenes.recorded_frame import LayoutReader


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
    """What a folder lacks that has all but one of the files of a layout; empty where it has none, or all of them."""
    for reader in readers():
        missing = [(name, what) for name, what in reader.NEEDS if not (folder / name).exists()]
        if len(missing) == 1 and len(reader.NEEDS) > 1:
            return f"looks like the {reader.LAYOUT}, but {missing[0][0]} is missing: {missing[0][1]}"
    return ""
