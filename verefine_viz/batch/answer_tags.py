"""Tags of a batch's answers: ``tags.json`` in the folder of the run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from verefine_viz.core.errors import InputError, first_fault
from verefine_viz.core.paths import atomic, read_input
from verefine_viz.run.record import Answer

TAGS_FILE = "tags.json"
MOST_LETTERS = 40
"""Of a tag."""


class TagFile(BaseModel):
    """What ``tags.json`` holds."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    tags: Mapping[str, tuple[str, ...]] = Field(default_factory=dict)
    """By answer: :func:`answer_key`."""


def answer_key(row: Answer) -> str:
    """How an answer is named in the file: ``3/120#2``, that is scene/image#instance."""
    return f"{row.frame}#{row.instance_id}"


def read_tags(folder: Path) -> TagFile:
    """What is kept beside a run; nothing where the file is not there.

    Raises:
        InputError: the file cannot be read or is damaged.
    """
    path = folder / TAGS_FILE
    if not path.exists():
        return TagFile()
    raw = read_input(path)
    try:
        return TagFile.model_validate_json(raw)
    except ValidationError as error:
        raise InputError(
            f"{path} is damaged ({first_fault(error)}); mend it, or delete it and with it the run's tags"
        ) from None


def save_tags(folder: Path, content: TagFile) -> None:
    """Replaces the file as a whole.

    Raises:
        InputError: it cannot be written.
    """
    with atomic(folder / TAGS_FILE) as part:
        part.write_text(content.model_dump_json(indent=1) + "\n", encoding="utf-8")


def checked_name(text: str) -> str:
    """A tag without spaces around it.

    Raises:
        InputError: it is empty or too long.
    """
    name = " ".join(text.split())
    if not 0 < len(name) <= MOST_LETTERS:
        raise InputError(f"{len(name)} letters are no tag; expected 1 to {MOST_LETTERS}")
    return name
