"""``verefine-viz report``: batches as one HTML file, the page's own bundle with numbers, gallery and failures in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.markup import escape

from verefine_viz import __version__
from verefine_viz.batch.index import batch_of, find_runs
from verefine_viz.batch.progress import counted_bar
from verefine_viz.batch.runs import Runs
from verefine_viz.batch.terminal import Terminal
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.writing import atomic, check_no_link, clear_parts
from verefine_viz.page.bundle import bundle, part, picture
from verefine_viz.page.gallery import Gallery, GalleryEntry
from verefine_viz.page.share import command_path, opened_answer, shared, write_shared
from verefine_viz.page.thumbnails import Painter
from verefine_viz.page.views.gallery_answers import answers_message
from verefine_viz.report.groups import read_runs, sections_of
from verefine_viz.report.pair_difference import wrong_in
from verefine_viz.report.report_message import StepProgress, report_message

Json = dict[str, Any]
FILE_NAME = "report.html"
MOST_PICTURES = 300
"""Cards with a picture, the worst answers first: 5 to 12 kB each."""


@dataclass(frozen=True)
class Written:
    """What a report came to."""

    headlines: tuple[str, ...]
    notes: tuple[str, ...]
    """What is missing in it, and why."""


def print_report(
    folder: Path, other: Path | None, out: Path | None, embed: int, beside: int, pictures: int, workers: int
) -> None:
    """Write the report of one or two folders of runs, and print what it says and where it is.

    Raises:
        VerefineError: a folder is no run, or the file cannot be written.
    """
    # A comparison does not take the place of the run's own report.
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
    with counted_bar("reading") as progress:
        written = write_report(runs, path, len(runs) == len(selections), embed, beside, pictures, workers, progress)
    console = Terminal(highlight=False, soft_wrap=True)
    for line in (*written.headlines, *(s.note for s in selections if s.note), *written.notes):
        console.print(escape(line))
    console.print(escape(f"Report in {path} ({path.stat().st_size / 1e6:.1f} MB)"))


def write_report(
    folders: Sequence[Path],
    path: Path,
    as_named: bool = True,
    embed: int = 0,
    beside: int = 0,
    pictures: int = MOST_PICTURES,
    workers: int = 1,
    progress: StepProgress = lambda what, done, of: None,
) -> Written:
    """Write the report of some runs.

    Args:
        folders: of batches.
        path: the HTML file.
        as_named: whether the user named these runs, one or two; else those that are not finished are left out.
        embed: frames with a wrong answer that can be opened in the file, the worst first.
        beside: so many more have a file of their own, in a folder beside it.
        pictures: answers that have a picture, the worst first.
        workers: threads for the BOP scores.
        progress: what is being done.

    Raises:
        VerefineError: a folder is no run, or the file cannot be written.
    """
    progress("reading", 0, 1)
    runs, left_out = read_runs(folders, only_finished=not as_named)
    sections = sections_of(runs, as_named and len(runs) == 2)
    gallery = Gallery(runs)
    message = report_message(sections, gallery, left_out, workers, progress)
    answers, notes = answers_message(gallery), list(message["notes"])
    group_of = {id(row): group.name for section in sections for group in section.groups for row in group.rows}
    compared: dict[int, str] = {}
    for section in sections:
        compared |= wrong_in(*section.pair) if section.pair else {}
    for row, entry in zip(answers["rows"], gallery.entries, strict=True):
        row |= {"group": group_of[id(entry.row)], "compared": compared.get(id(entry.row), ""), "thumb": False}
        row |= {"command": f"verefine-viz view {_run_file(gallery, entry)}", "part": None, "file": None}
    elements = [
        *_pictures(gallery, answers, pictures, notes, progress),
        *_frames(gallery, answers, embed, beside, path.with_name(f"{path.stem}-frames"), notes, progress),
    ]
    command = f"verefine-viz view {command_path(folders[0] if len(folders) == 1 else folders[0].parent)}"
    messages = [
        {"t": "hello", "window": 0, "version": __version__},
        {"t": "file", "command": command, "maps": "end", "scene": False},
        message,
        answers,
    ]
    progress("writing", 0, 1)
    with atomic(path) as file:
        file.write_text(bundle(messages, (), elements, message["title"]), encoding="utf-8", errors="replace")
    n_left = len(left_out)
    notes += [f"{n_left} of {len(folders)} runs left out, see the report."] if n_left else []
    notes += [f"{one['data']}: {one['bop']}" for one in message["sections"] if "No BOP scores" in one["bop"]]
    headlines = [f"{message['title']}: {message['counted']}."]
    for one in message["sections"]:
        headlines.append(f"{one['data']}: {one['headline']}" if len(message["sections"]) > 1 else one["headline"])
    return Written(tuple(headlines), tuple(dict.fromkeys(notes)))


def _pictures(gallery: Gallery, answers: Json, most: int, notes: list[str], progress: StepProgress) -> list[str]:
    """The small pictures of the worst answers; their rows learn that they have one."""
    paint, drawn = Painter(lambda: gallery), list[str]()
    keys = [key for key in answers["orders"][0]["keys"] if gallery.entries[key].row.was_asked_for][:most]
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
            drawn.append(picture(f"/thumb/{key}", image, "image/webp"))
            answers["rows"][key]["thumb"] = True
    notes += failed
    return drawn


def _frames(
    gallery: Gallery, answers: Json, embed: int, beside: int, folder: Path, notes: list[str], progress: StepProgress
) -> list[str]:
    """The worst frames as parts of the file, as ``verefine-viz share`` has them; of a good run the worst one, without
    ground truth the most doubtful ones.

    So many more are written into ``folder``, a file each.
    """
    entries = gallery.entries
    worst = [key for key in answers["orders"][0]["keys"] if entries[key].can_be_opened]
    # Where there is no answer there is less to see. Where no ground truth is known, any answer may be wrong.
    wrong = sorted((k for k in worst if entries[k].is_wrong), key=lambda k: entries[k].row.status != "ok")
    wrong = wrong or (worst[:1] if any(entry.row.can_be_right for entry in entries) else worst)
    frames: dict[tuple[str, str, str, int | None], list[int]] = {}
    for key in wrong:
        row = entries[key].row
        # Several runs may have the frame, or a folder of run files several of it.
        frames.setdefault((entries[key].run, row.frame, row.method, row.seed), []).append(key)
    parts = list[str]()
    for done, ((run, frame, *_), keys) in enumerate(list(frames.items())[: embed + beside]):
        progress("failures", done, min(embed + beside, len(frames)))
        objects = {i for key in keys if (i := entries[key].row.instance_id) is not None}
        try:
            debugger = opened_answer(gallery, entries[keys[0]])
            known = shared(debugger, answers["rows"][keys[0]]["command"], "end", objects, f"p{done}-")
        except VerefineError as error:
            notes.append(f"Frames cannot be opened in the report: {error}.")
            continue
        if done >= embed:
            check_no_link(folder)
            file = folder / f"{run}_{frame.replace('/', '_')}_{done}.html"
            write_shared(known, "", file)
            for key in keys:
                answers["rows"][key]["file"] = f"{folder.name}/{file.name}"
            continue
        messages = [message | {"run": run} if message["t"] == "frame" else message for message in known.messages]
        parts += [*known.elements, part(f"part {done}", messages, known.answers)]
        for key in keys:
            answers["rows"][key]["part"] = done
    return parts


def _run_file(gallery: Gallery, entry: GalleryEntry) -> str:
    """The run file of an answer as a command has it."""
    folder = gallery.runs[entry.run].folder
    path = gallery.loose_record(entry) or Runs(folder / "runs").path(entry.row.frame)
    return str(path.relative_to(folder.parent) if path.is_absolute() else path)
