"""Replaces files and folders together: all of them, or none; what was there is kept."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from verefine_viz.core.errors import InputError
from verefine_viz.core.writing import check_no_link, clear_parts, make_inside, path_fault

REPLACED = "replaced"
"""Folders ``replaced-1``, ``replaced-2``, … hold what was replaced, under the names that it had."""


@contextmanager
def taking_places(places: Sequence[Path], overwrite: bool = False) -> Iterator[Mapping[Path, Path]]:
    """Paths to write to, one beside each place, for files and folders that the block makes there. When it ends without
    an error, they take their places in this order; a place for which nothing was made stays as it is.

    A process that is killed in that instant leaves the first ones in place; before, nothing is in place.

    Args:
        places: where each belongs; the folders that hold them exist and are no links.
        overwrite: whether existing files and folders may be moved to a folder ``replaced-N`` beside them.

    Raises:
        InputError: something is there and ``overwrite`` is not set, or a path cannot be written; all is as before.
    """
    there = [place for place in places if os.path.lexists(place)]
    if there and not overwrite:
        raise InputError(f"{there[0]} is there already; to replace it and keep a copy of it beside it, add --overwrite")
    for folder in {place.parent for place in places}:
        check_no_link(folder)
        clear_parts(folder)
    writer = f"{os.getpid()}-{threading.get_ident()}"
    parts = {place: place.with_name(f"{place.name}.{writer}.part") for place in places}
    for part in parts.values():
        _remove(part)
    try:
        yield parts
        made = [(part, place) for place, part in parts.items() if os.path.lexists(part)]
        _moved([*_replacements([place for _, place in made if os.path.lexists(place)]), *made])
    except OSError as error:
        path = Path(error.filename or places[0])
        raise InputError(f"cannot write {path}: {path_fault(path, error)}") from None
    finally:
        for part in parts.values():
            _remove(part)


def _remove(part: Path) -> None:
    if part.is_dir() and not part.is_symlink():
        shutil.rmtree(part, ignore_errors=True)
    else:
        part.unlink(missing_ok=True)


def _replacements(there: Sequence[Path]) -> list[tuple[Path, Path]]:
    """Existing files and the places where they are kept: those of one folder in one new folder inside it."""
    kept: dict[Path, str] = {}
    for path in there:
        if path.parent not in kept:
            names = (f"{REPLACED}-{n}" for n in count(1))
            kept[path.parent] = next(name for name in names if not os.path.lexists(path.parent / name))
            make_inside(path.parent, kept[path.parent])
    return [(path, path.parent / kept[path.parent] / path.name) for path in there]


def _moved(moves: Sequence[tuple[Path, Path]]) -> None:
    """Rename all, or none."""
    done: list[tuple[Path, Path]] = []
    try:
        for before, after in moves:
            before.rename(after)
            done.append((before, after))
    except OSError:
        for before, after in reversed(done):
            after.rename(before)
        raise
