"""What ``verefine-viz report`` does: of one run, of two compared, or of the groups that many runs make."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from verefine_viz.batch.index import batch_of, find_runs
from verefine_viz.batch.progress import counted_bar
from verefine_viz.core.errors import InputError
from verefine_viz.core.paths import atomic, clear_parts
from verefine_viz.report.bop_recalls import bop_recalls, frame_recalls
from verefine_viz.report.failure_cards import gallery, group_gallery, pair_gallery
from verefine_viz.report.group_comparison import compare
from verefine_viz.report.group_page import render_groups
from verefine_viz.report.group_sentences import counted, headline
from verefine_viz.report.groups import Progress, load_groups
from verefine_viz.report.run_difference import difference
from verefine_viz.report.run_page import Side, render
from verefine_viz.report.run_results import load, load_pair

FILE_NAME = "report.html"
MOST_FAILURES = 60
"""Failures with pictures, of all runs together, unless another number is asked for."""
StepProgress = Callable[[str, int, int], None]
"""Called with what is being done, how many parts of it are done, and how many there are."""


def print_report(folder: Path, other: Path | None, out: Path | None, most_failures: int, workers: int) -> None:
    """Writes the report and prints where it is: of a run, of two side by side, or of the groups that many runs make.

    Raises:
        VerefineError: a folder is no run, the runs do not go together, or the file cannot be written.
    """
    # A comparison does not take the place of the run's own report.
    name = f"report-against-{other.resolve().name}.html" if other else FILE_NAME
    folder = batch_of(folder)
    path = out or folder / name
    clear_parts(path.parent, path.name)
    selections = [find_runs(named) for named in (folder, other) if named is not None]
    runs = [run for selection in selections for run in selection.runs]
    with counted_bar("reading") as progress:
        if len(runs) > len(selections):
            notes = write_group_report(runs, path, most_failures, workers, progress)
        else:
            notes = write_report(runs[0], runs[1] if other else None, path, most_failures, workers, progress)
    console = Console(highlight=False, soft_wrap=True)
    for note in (*(selection.note for selection in selections if selection.note), *notes):
        console.print(escape(note))
    console.print(escape(f"Report in {path} ({path.stat().st_size / 1e6:.1f} MB)"))


def write_report(
    folder: Path,
    other: Path | None,
    path: Path,
    most_failures: int = MOST_FAILURES,
    workers: int = 1,
    progress: StepProgress = lambda what, done, of: None,
) -> tuple[str, ...]:
    """Writes the report of the run in ``folder``, beside that in ``other`` if there is one, into the file ``path``.

    Args:
        folder: a batch folder.
        other: another one.
        path: the HTML file.
        most_failures: failures with pictures.
        workers: threads for the BOP scores.
        progress: see :data:`StepProgress`.

    Returns:
        What is missing in it, and why.

    Raises:
        VerefineError: a folder is no run, the two do not go together, or the file cannot be written.
    """
    _check(path)
    a, b = load_pair(folder, other) if other else (load(folder), None)
    sides = [
        Side(run, bop_recalls(run, workers, _step(progress, f"BOP scores {run.label}".strip())))
        for run in (a, b)
        if run is not None
    ]
    pictures = _step(progress, "pictures")
    failures = pair_gallery(a, b, most_failures, pictures) if b else gallery(a, most_failures, pictures)
    _write(path, render(sides[0], sides[1] if b else None, difference(a, b) if b else None, failures))
    missing = [f"{note}." for side in sides for note in side.run.index.notes]
    return tuple(dict.fromkeys((*missing, *(side.bop.note for side in sides if side.bop.ar is None), *failures.notes)))


def write_group_report(
    folders: Sequence[Path],
    path: Path,
    most_failures: int = MOST_FAILURES,
    workers: int = 1,
    progress: StepProgress = lambda what, done, of: None,
) -> tuple[str, ...]:
    """Writes the report that compares the groups of finished runs in ``folders``; arguments as :func:`write_report`.

    Returns:
        The result in a few words, and what is missing, and why.

    Raises:
        VerefineError: no run can be used, or they are about different data; and as :func:`write_report`.
    """
    _check(path)
    groups = load_groups(folders, _step(progress, "reading runs"))
    bop = frame_recalls(groups.runs, workers, _step(progress, "BOP scores"))
    progress("comparing", 0, 1)
    comparison = compare(groups.groups, bop)
    failures = group_gallery(comparison.groups, most_failures, _step(progress, "pictures"))
    progress("writing", 0, 1)
    _write(path, render_groups(groups, comparison, failures))
    n_left = len(groups.left_out)
    left = (f"{n_left} of {len(folders)} runs left out, see the report.",) if n_left else ()
    without = () if comparison.has_ar else (bop.note,)
    return (f"{counted(comparison)}.", headline(comparison), *left, *without, *failures.notes)


def _step(progress: StepProgress, what: str) -> Progress:
    return lambda done, of: progress(what, done, of)


def _check(path: Path) -> None:
    if path.is_dir():
        raise InputError(f"--out {path} is a folder, expected the name of a file")


def _write(path: Path, html: str) -> None:
    with atomic(path) as part:
        part.write_text(html, encoding="utf-8")
