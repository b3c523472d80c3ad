"""What ``verefine-viz report`` does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from verefine_viz.batch.index import find_runs
from verefine_viz.batch.progress import counted_bar
from verefine_viz.core.errors import InputError
from verefine_viz.core.paths import clear_parts
from verefine_viz.report.bop_recalls import bop_recalls
from verefine_viz.report.failure_cards import Gallery, gallery, group_gallery, pair_gallery
from verefine_viz.report.group_comparison import compare, frame_recalls
from verefine_viz.report.group_page import render_groups
from verefine_viz.report.group_sentences import counted, headline
from verefine_viz.report.groups import load_groups
from verefine_viz.report.html import write
from verefine_viz.report.run_difference import difference
from verefine_viz.report.run_page import Side, render
from verefine_viz.report.run_results import Loaded, load, load_pair

FILE_NAME = "report.html"
Tell = Callable[[str, int, int], None]
"""Told what is being done, how many are done, and how many there are."""


def _silent(what: str, done: int, of: int) -> None:
    """Nobody is told."""


@dataclass(frozen=True)
class Making:
    """How a report is made."""

    most_failures: int = 60
    """Failures with pictures, of all runs together."""
    workers: int = 1
    """Threads for the BOP scores."""
    tell: Tell = _silent
    """Progress."""


AS_USUAL = Making()


def print_report(folder: Path, other: Path | None, out: Path | None, most_failures: int, workers: int) -> None:
    """Writes the report and says where it is: of a run, of two side by side, or of the groups that many runs make.

    Raises:
        VerefineError: a folder is no run, the runs do not go together, or the file cannot be written.
    """
    # A comparison does not take the place of the run's own report.
    name = f"report-against-{other.resolve().name}.html" if other else FILE_NAME
    path = out or folder / name
    clear_parts(path.parent, path.name)
    places = [find_runs(place) for place in (folder, other) if place is not None]
    found = [run for place in places for run in place.runs]
    several = len(found) > (1 if other is None else 2)
    if not several:
        folder, other = found[0], found[1] if other else None
    with counted_bar("reading") as tell:
        making = Making(most_failures, workers, tell)
        notes = write_group_report(found, path, making) if several else write_report(folder, other, path, making)
    console = Console(highlight=False, soft_wrap=True)
    for note in (*(place.note for place in places if place.note), *notes):
        console.print(escape(note))
    console.print(escape(f"Report in {path} ({path.stat().st_size / 1e6:.1f} MB)"))


def write_report(folder: Path, other: Path | None, path: Path, making: Making = AS_USUAL) -> tuple[str, ...]:
    """Writes the report of the run in ``folder``, beside that in ``other`` if there is one, into the file ``path``.

    Returns:
        What is missing in it, and why.

    Raises:
        VerefineError: a folder is no run, the two do not go together, or the file cannot be written.
    """
    _check(path)
    a, b = load_pair(folder, other) if other else (load(folder), None)
    sides = [
        Side(run, bop_recalls(run, making.workers, _telling(making.tell, run))) for run in (a, b) if run is not None
    ]
    found = difference(a, b) if b else None
    failures = _failures(a, b, making)
    html = render(sides[0], sides[1] if b else None, found, failures)
    write(path, html)
    return tuple(dict.fromkeys((*(side.bop.note for side in sides if side.bop.total is None), *failures.notes)))


def write_group_report(folders: Sequence[Path], path: Path, making: Making = AS_USUAL) -> tuple[str, ...]:
    """Writes the report that compares the groups of finished runs in ``folders``.

    Returns:
        What was found in a few words, and what is missing, and why.

    Raises:
        VerefineError: no run can be used, or they are about different data; and as :func:`write_report`.
    """
    tell = making.tell
    _check(path)
    groups = load_groups(folders, lambda done, of: tell("reading runs", done, of))
    bop = frame_recalls(groups.runs, making.workers, lambda done, of: tell("BOP scores", done, of))
    tell("comparing", 0, 1)
    found = compare(groups.groups, bop)
    failures = group_gallery(found.groups, making.most_failures, lambda done, of: tell("pictures", done, of))
    tell("writing", 0, 1)
    write(path, render_groups(groups, found, failures))
    n_left = len(groups.left_out)
    left = (f"{n_left} of {len(folders)} runs left out, see the report.",) if n_left else ()
    without = () if found.has_ar else (bop.note,)
    return (f"{counted(found)}.", headline(found), *left, *without, *failures.notes)


def _failures(a: Loaded, b: Loaded | None, making: Making) -> Gallery:
    def tell(done: int, of: int) -> None:
        making.tell("pictures", done, of)

    return pair_gallery(a, b, making.most_failures, tell) if b else gallery(a, making.most_failures, tell)


def _check(path: Path) -> None:
    if path.is_dir():
        raise InputError(f"--out {path} is a folder, expected the name of a file")


def _telling(tell: Tell, run: Loaded) -> Callable[[int, int], None]:
    return lambda done, of: tell(f"BOP scores {run.label}".strip(), done, of)
