"""The table of remedies that were tried: its rows, what became of each answer, and its files."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Literal

import msgspec
from msgspec import Struct

from verefine_viz.core.causes import cause_title
from verefine_viz.core.errors import InputError
from verefine_viz.core.files import read_json
from verefine_viz.core.writing import atomic, write_json

FIX_FOLDER = "fix"
"""Folder beside runs for the batches of remedies that were tried on them."""
CSV_FILE, FIX_FILE = "fix.csv", "fix.json"
EVERY_CAUSE = "all"
"""Stands for the cause in the row of a remedy over all of its causes."""
JudgedBy = Literal["ground truth", "fit"]
"""How a change is judged; "fit" is without ground truth, by the first that differs: physics, score (Eq. 1), how far
an answer is undetermined."""


class FixRow(Struct, frozen=True, kw_only=True):
    """What one remedy did for one cause. None = unknown.

    ``make tables`` writes the docstrings of its fields into docs/tables.md.
    """

    remedy: str
    """The setting and its new value; several with ``+`` between them."""
    cause: str
    """Cause of the answers that the remedy was tried on, one of docs/causes.md; ``all``: every cause."""
    judged_by: JudgedBy
    """``ground truth``; or, without it, ``fit``: by physics, else the score (Eq. 1), else how far the answer is
    undetermined. Answers then fit better or worse, which need not mean right or wrong."""
    tried: int
    """Answers that were wrong or missing; without ground truth, answers in doubt."""
    came_right: int
    """How many of these are right with the remedy; without ground truth, how many fit better."""
    worse: int
    """How many of these fit worse; 0 with ground truth."""
    right_tried: int
    """Answers that were right, in the same frames and in those of the sample."""
    broke: int
    """How many of these are wrong with the remedy, or fit worse."""
    right_known: int
    """All answers of the runs that were right."""
    net_gain: float
    """``came_right`` minus ``worse``, minus what the remedy would break among all ``right_known``, at the rate at which
    it broke those of ``right_tried``."""
    net_low: float
    """Lower end of the 95 % interval of ``net_gain``, from the Wilson interval of each share."""
    net_high: float
    """Upper end of that interval."""
    seconds_added: float | None = None
    """Time that the remedy adds to a frame, mean over the frames solved with it [s]."""

    @property
    def cause_words(self) -> str:
        """The cause as tables show it."""
        if self.cause == EVERY_CAUSE:
            return "every cause"
        return cause_title(self.cause) if self.cause else "unknown"


class FixAnswer(Struct, frozen=True, kw_only=True):
    """One answer before and after a remedy."""

    remedy: str
    cause: str
    run: str
    """Name of the folder of the answer's batch."""
    folder: str
    """Folder of the batch with the remedy, below that of the table."""
    frame: str
    instance_id: int | None
    name: str
    by_truth: bool
    was_bad: bool
    change: int
    """1: came right, or fits better; -1: broke, or fits worse; 0: neither."""
    errors_mm: tuple[float | None, float | None]
    """ADD(-S) before and after."""
    scores: tuple[float | None, float | None]


class FixTable(Struct, frozen=True):
    """The content of fix.json."""

    seed: int
    every: bool
    together: tuple[str, ...]
    """Remedies that were tried all together."""
    rows: tuple[FixRow, ...]
    """Largest net gain first."""
    answers: tuple[FixAnswer, ...]


def write_fix(table: FixTable, folder: Path) -> None:
    """Write fix.csv and fix.json.

    Raises:
        InputError: the disk refuses.
    """
    with atomic(folder / CSV_FILE) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(FixRow.__struct_fields__)
        writer.writerows([_cell(getattr(row, name)) for name in FixRow.__struct_fields__] for row in table.rows)
    write_json(folder / FIX_FILE, msgspec.to_builtins(table))


def _cell(value: object) -> object:
    return f"{value:.3f}" if isinstance(value, float) else "" if value is None else value


def read_fix(folder: Path) -> FixTable | None:
    """The table of the remedies that were tried on a folder of runs, in its ``fix``; None where there is none.

    Raises:
        InputError: it is damaged.
    """
    file = fix_folder(folder) / FIX_FILE
    return read_json(file, FixTable, "table of remedies") if file.is_file() else None


def fix_folder(folder: Path) -> Path:
    """Where remedies for the runs of a folder are tried, if no other place is named."""
    return folder / FIX_FOLDER


def best_row(table: FixTable) -> FixRow:
    """The row with the largest net gain.

    Raises:
        InputError: no remedy gains anything.
    """
    if not table.rows or table.rows[0].net_gain <= 0:
        raise InputError("no remedy gains anything; name those to write with --take")
    return table.rows[0]
