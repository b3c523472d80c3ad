"""``verefine-viz report``: batches as one HTML file, the page's own bundle with numbers, gallery and failures in it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from msgspec import structs

from verefine_viz.batch.fix_files import FixTable, read_fix
from verefine_viz.batch.index import batch_of, find_runs
from verefine_viz.batch.runs import Runs
from verefine_viz.core.console import ProgressBar
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.text_format import say
from verefine_viz.core.writing import atomic, check_no_link, clear_parts
from verefine_viz.page.bundle import bundle, command_path, part, picture
from verefine_viz.page.frame_messages import FrameMessage
from verefine_viz.page.gallery import Gallery, GalleryEntry
from verefine_viz.page.messages import FileMessage
from verefine_viz.page.sent_palette import hello
from verefine_viz.page.views.gallery_answers import answers_message
from verefine_viz.page.views.tried_remedies import fix_shown, keys_of
from verefine_viz.report.groups import read_runs, sections_of
from verefine_viz.report.pair_difference import wrong_in
from verefine_viz.report.report_message import RecallsOf, StepProgress, report_message

if TYPE_CHECKING:
    from verefine_viz.page.share import SharedRun
    from verefine_viz.page.thumbnails import Painter

FILE_NAME = "report.html"
MOST_PICTURES = 300
"""Most cards with a picture, the worst answers first: 5 to 12 kB each."""
MOST_FILMS = 12
"""Most answers with a film, the worst first: 40 to 90 kB each."""


@dataclass(frozen=True)
class Report:
    """A report that was written."""

    path: Path
    """The HTML file."""
    headlines: tuple[str, ...]
    """Its main results: counts, recall, or which of two is better."""
    notes: tuple[str, ...]
    """What it lacks, and why."""

    def __fspath__(self) -> str:
        return str(self.path)


@dataclass(frozen=True)
class ReportTools:
    """The functions that compute and draw for a report; ``report_tools.py`` puts them together."""

    recalls_of: RecallsOf
    painter_of: Callable[[Gallery], Painter]
    """Makes the functions that draw small pictures and films of a gallery's answers as WebP, empty where that is
    impossible."""
    shared_answer: Callable[[Gallery, GalleryEntry, str, Collection[int], str], SharedRun]
    """Gathers what the page shows of an answer's frame, from the command that opens it, the instances shown in depth,
    and the beginning of its arrays' keys."""
    write_shared: Callable[[SharedRun, str, Path], str]
    """Writes it as a file of its own, with a 3D view or "" for none."""


def print_report(
    folder: Path, other: Path | None, out: Path | None, embed: int, beside: int, pictures: int, tools: ReportTools
) -> None:
    """Write the report of one or two folders of runs, and print what it says and where it is.

    Raises:
        VerefineError: a folder is no run, or the file cannot be written.
    """
    with ProgressBar("reading") as bar:
        report = report_of(folder, other, out, embed, beside, pictures, tools, bar.show)
    for line in (*report.headlines, *report.notes):
        say(line)
    say(f"Report in {report.path} ({report.path.stat().st_size / 1e6:.1f} MB)")


def report_of(
    folder: Path,
    other: Path | None,
    out: Path | None,
    embed: int,
    beside: int,
    pictures: int,
    tools: ReportTools,
    progress: StepProgress,
) -> Report:
    """Write the report of one or two folders of runs; without ``out`` into the first.

    Raises:
        VerefineError: a folder is no run, or the file cannot be written.
    """
    # A comparison must not replace the run's own report.
    name = f"report-against-{other.resolve().name}.html" if other else FILE_NAME
    folder = batch_of(folder)
    path = out or folder / name
    if path.is_dir():
        raise InputError(f"--out {path} is a folder, expected the name of a file")
    if other is not None and folder.resolve() == other.resolve():
        raise InputError(f"{folder} and {other} are the same folder; name two runs, or one")
    clear_parts(path.parent, path.name)
    selections = [find_runs(named) for named in (folder, other) if named is not None]
    runs = [run for selection in selections for run in selection.runs]
    fix = read_fix(folder) if other is None else None
    written = write_report(runs, path, tools, len(runs) == len(selections), embed, beside, pictures, progress, fix)
    return replace(written, notes=(*(one.note for one in selections if one.note), *written.notes))


def write_report(
    folders: Sequence[Path],
    path: Path,
    tools: ReportTools,
    as_named: bool = True,
    embed: int = 0,
    beside: int = 0,
    pictures: int = MOST_PICTURES,
    progress: StepProgress = lambda what, done, of: None,
    fix: FixTable | None = None,
) -> Report:
    """Write the report of some runs.

    Args:
        folders: of batches.
        path: the HTML file.
        tools: functions that compute and draw.
        as_named: whether the user named these runs, one or two; else those that are not finished are left out.
        embed: frames with a wrong answer that can be opened in the file, the worst first.
        beside: this many more get a file of their own, in a folder beside the report.
        pictures: answers that have a picture, the worst first.
        progress: shows what is being done.
        fix: remedies that were tried on the runs.

    Raises:
        VerefineError: a folder is no run, or the file cannot be written.
    """
    progress("reading", 0, 1)
    runs, left_out = read_runs(folders, only_finished=not as_named)
    sections = sections_of(runs, as_named and len(runs) == 2)
    gallery = Gallery(runs)
    message = report_message(sections, gallery, left_out, tools.recalls_of, progress)
    if fix is not None:
        message = structs.replace(message, fix=fix_shown(fix, keys_of(gallery), None))
    answers, notes = answers_message(gallery), list(message.notes)
    worst_first = answers.orders[0].keys
    painter = tools.painter_of(gallery)
    painted = _pictures(painter, "thumb", gallery, worst_first, pictures, notes, progress)
    filmed = [key for key in worst_first if answers.rows[key].film and key in painted]
    films = _pictures(painter.film, "film", gallery, filmed, MOST_FILMS, notes, progress)
    folder = path.with_name(f"{path.stem}-frames")
    shown = _frames(tools, gallery, worst_first, embed, beside, folder, notes, progress)
    group_of = {id(row): group.name for section in sections for group in section.groups for row in group.rows}
    compared: dict[int, str] = {}
    for section in sections:
        compared |= wrong_in(*section.pair) if section.pair else {}
    rows = [
        structs.replace(
            row,
            group=group_of[id(entry.row)],
            compared=compared.get(id(entry.row), ""),
            thumb=row.key in painted,
            film=row.key in films,
            command=_command(gallery, entry),
            part=shown.parts.get(row.key),
            file=shown.files.get(row.key),
        )
        for row, entry in zip(answers.rows, gallery.entries, strict=True)
    ]
    command = f"verefine-viz view {command_path(folders[0] if len(folders) == 1 else folders[0].parent)}"
    messages = [
        hello(0),
        FileMessage(command, "end", scene=False),
        message,
        structs.replace(answers, rows=rows),
    ]
    progress("writing", 0, 1)
    with atomic(path) as file:
        page = bundle(messages, (), [*painted.values(), *films.values(), *shown.elements], message.title)
        file.write_text(page, encoding="utf-8", errors="replace")
    n_left = len(left_out)
    notes += [f"{n_left} of {len(folders)} runs left out, see the report."] if n_left else []
    notes += [f"{one.data}: {one.bop}" for one in message.sections if "No BOP scores" in one.bop]
    headlines = [f"{message.title}: {message.counted}."]
    for one in message.sections:
        headlines.append(f"{one.data}: {one.headline}" if len(message.sections) > 1 else one.headline)
    return Report(path, tuple(headlines), tuple(dict.fromkeys(notes)))


def _pictures(
    paint: Callable[[GalleryEntry], bytes],
    what: Literal["thumb", "film"],
    gallery: Gallery,
    worst_first: Sequence[int],
    most: int,
    notes: list[str],
    progress: StepProgress,
) -> dict[int, str]:
    """The small pictures, or films, of the worst answers as HTML, by their keys."""
    drawn = dict[int, str]()
    keys = [key for key in worst_first if gallery.entries[key].row.was_asked_for][:most]
    # Frame by frame: a frame is read once.
    keys.sort(key=lambda key: (gallery.entries[key].row.frame, key))
    failed: dict[str, None] = {}
    for done, key in enumerate(keys):
        progress("pictures", done, len(keys))
        try:
            image = b"" if failed else paint(gallery.entries[key])
        except VerefineError as error:
            failed[f"No pictures: {error}."] = None
            continue
        if image:
            drawn[key] = picture(f"/{what}/{key}", image, "image/webp")
    notes += failed
    return drawn


@dataclass(frozen=True)
class ShownFrames:
    """Frames that can be opened in a report, by the keys of their answers."""

    elements: list[str] = field(default_factory=list)
    """HTML of the frames inside the file."""
    parts: dict[int, int] = field(default_factory=dict)
    """Their numbers among the file's parts."""
    files: dict[int, str] = field(default_factory=dict)
    """Files beside the report."""


def _frames(
    tools: ReportTools,
    gallery: Gallery,
    worst_first: Sequence[int],
    embed: int,
    beside: int,
    folder: Path,
    notes: list[str],
    progress: StepProgress,
) -> ShownFrames:
    """The worst frames as parts of the file, as ``verefine-viz share`` has them; of a good run the worst one, without
    ground truth the most doubtful ones.

    ``beside`` more are written into ``folder``, a file each.
    """
    entries = gallery.entries
    worst = [key for key in worst_first if entries[key].can_be_opened]
    # A frame without an answer shows less. Without ground truth, any answer may be wrong.
    wrong = sorted((k for k in worst if entries[k].is_wrong), key=lambda k: entries[k].row.status != "ok")
    wrong = wrong or (worst[:1] if any(entry.row.can_be_right for entry in entries) else worst)
    frames: dict[tuple[str, str, str, int | None], list[int]] = {}
    for key in wrong:
        row = entries[key].row
        # Several runs may have the frame, or a folder may hold several run files of it.
        frames.setdefault((entries[key].run, row.frame, row.method, row.seed), []).append(key)
    shown = ShownFrames()
    for done, ((run, frame, *_), keys) in enumerate(list(frames.items())[: embed + beside]):
        progress("failures", done, min(embed + beside, len(frames)))
        objects = {i for key in keys if (i := entries[key].row.instance_id) is not None}
        try:
            entry = entries[keys[0]]
            known = tools.shared_answer(gallery, entry, _command(gallery, entry), objects, f"p{done}-")
        except VerefineError as error:
            notes.append(f"Frames cannot be opened in the report: {error}.")
            continue
        if done >= embed:
            check_no_link(folder)
            file = folder / f"{run}_{frame.replace('/', '_')}_{done}.html"
            tools.write_shared(known, "", file)
            shown.files.update(dict.fromkeys(keys, f"{folder.name}/{file.name}"))
            continue
        messages = [structs.replace(one, run=run) if isinstance(one, FrameMessage) else one for one in known.messages]
        shown.elements.extend((*known.elements, part(f"part {done}", messages, known.answers)))
        shown.parts.update(dict.fromkeys(keys, done))
    return shown


def _command(gallery: Gallery, entry: GalleryEntry) -> str:
    """Return the command that opens the run of an answer."""
    folder = gallery.runs[entry.run].folder
    path = gallery.loose_record(entry) or Runs(folder / "runs").path(entry.row.frame)
    return f"verefine-viz view {path.relative_to(folder.parent) if path.is_absolute() else path}"
