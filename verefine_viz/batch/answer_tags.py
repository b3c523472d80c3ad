"""Tags of a batch's answers: ``tags.json`` in the folder of the run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import read_json
from verefine_viz.core.writing import write_json
from verefine_viz.run.record import Answer

TAGS_FILE = "tags.json"
MOST_LETTERS = 40
"""Most letters of a tag."""


class TagFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What ``tags.json`` holds."""

    tags: Mapping[str, tuple[str, ...]] = {}
    """Tags by :func:`answer_key`."""


def answer_key(row: Answer) -> str:
    """The name of an answer in the file: ``3/120#2``, that is scene/image#instance."""
    return f"{row.frame}#{row.instance_id}"


def read_tags(folder: Path) -> TagFile:
    """The tags of a run's answers; none where it has no file of them.

    Raises:
        InputError: the file cannot be read or is damaged.
    """
    path = folder / TAGS_FILE
    return read_json(path, TagFile, "tags") if path.exists() else TagFile()


def save_tags(folder: Path, content: TagFile) -> None:
    """Write the tags of a run, in place of all that its file holds.

    Raises:
        InputError: it cannot be written.
    """
    write_json(folder / TAGS_FILE, msgspec.to_builtins(content))


def checked_name(text: str) -> str:
    """A tag without spaces around it.

    Raises:
        InputError: it is empty or too long.
    """
    name = " ".join(text.split())
    if not 0 < len(name) <= MOST_LETTERS:
        raise InputError(f"a tag of {len(name)} letters; expected 1 to {MOST_LETTERS}")
    return name
