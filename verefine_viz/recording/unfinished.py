"""The files of a recording while it is written, and what happens to them at its end."""

from __future__ import annotations

from pathlib import Path

from verefine_viz.core.errors import InputError


def part_path(path: Path) -> Path:
    """Where a recording lies while it is written."""
    return path.with_name(path.name + ".part")


def journal_path(path: Path) -> Path:
    """The journal beside a recording that is being written."""
    return path.with_name(path.name + ".journal")


def name_finished(path: Path) -> None:
    """Gives a finished recording its name; the journal is not needed any more.

    Raises:
        InputError: its name cannot be given to it.
    """
    try:
        part_path(path).replace(path)
        journal_path(path).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"cannot write the recording {path}: {error.strerror}") from None
