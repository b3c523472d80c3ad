"""The answers of one or several batch runs, to sort, filter and open."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import structs

from verefine_viz.batch.answer_orders import Order, sort_key
from verefine_viz.batch.answer_tags import TagFile, answer_key, checked_name, read_tags, save_tags
from verefine_viz.batch.folder import SESSION_FILE
from verefine_viz.batch.index import BatchIndex, find_runs, has_finished_frame, read_batch
from verefine_viz.batch.runs import RUN_FILE, Runs
from verefine_viz.batch.totals import describe_doubts
from verefine_viz.core.causes import Cause, cause_title
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.settings import Session
from verefine_viz.run.record import WAITING, Answer
from verefine_viz.run.run_file import SUFFIX, read_run_file
from verefine_viz.run.session_file import load_session

if TYPE_CHECKING:
    from verefine_viz.page.workspace import Records

WRONG, RIGHT, UNKNOWN = "wrong or no answer", "right", "unknown"
RIGHT_SEEN = "right as far as the image shows"
"""Results, to filter by."""


@dataclass(frozen=True)
class GalleryEntry:
    """One object of a frame, as one run answered it; or a frame of a watched folder that is not solved yet."""

    run: str
    """Name of the run's folder."""
    row: Answer

    @property
    def is_waiting(self) -> bool:
        """Whether it is a frame that is not solved yet."""
        return self.row.is_waiting

    @property
    def is_wrong(self) -> bool:
        """Whether the answer is wrong or missing; False also where that is unknown."""
        return not self.is_waiting and (self.row.status != "ok" or self.row.is_correct is False)

    @property
    def result(self) -> str:
        """Its result, to filter by."""
        if self.is_wrong and self.row.right_seen:
            return RIGHT_SEEN
        return WRONG if self.is_wrong else WAITING if self.is_waiting else RIGHT if self.row.is_correct else UNKNOWN

    @property
    def cause_title(self) -> str:
        """Why it is wrong, to filter by; "" = unknown."""
        return cause_title(self.row.cause)

    @property
    def can_be_opened(self) -> bool:
        """Whether its frame can be opened; not where the frame failed as a whole or the object was excluded."""
        return self.row.was_asked_for

    @property
    def iteration(self) -> int:
        """The iteration to open: where it went wrong, else where the answer was made; 0 = before iteration 1."""
        row = self.row
        return (row.best_iteration if row.worst_iteration is None else row.worst_iteration) or 0


class Gallery:
    """All answers.

    Args:
        indices: the runs, at least one.
        n_unfinished: unfinished runs that lie beside them.
        overrides: settings that win over those of the runs when a frame is opened.
        notes: on other runs that cannot be read.
    """

    def __init__(
        self,
        indices: Sequence[BatchIndex],
        n_unfinished: int = 0,
        overrides: Mapping[str, Any] | None = None,
        notes: Sequence[str] = (),
    ) -> None:
        names = Counter(index.folder.name for index in indices)
        self.runs = {
            index.folder.name if names[index.folder.name] == 1 else str(index.folder): index for index in indices
        }
        """By the name of their folder."""
        self.n_unfinished = n_unfinished
        self.notes = (*notes, *(note for index in indices for note in index.notes))
        """What is missing."""
        self.entries = tuple(GalleryEntry(run, row) for run, index in self.runs.items() for row in index.rows)
        self._overrides = overrides or {}
        self._sessions: dict[str, Session] = {}
        self._files: dict[str, TagFile] = {}
        self.tag_faults: dict[str, str] = {}
        """Why the tags of a run cannot be read."""
        for run, index in self.runs.items():
            try:
                self._files[run] = read_tags(index.folder)
            except InputError as error:
                self._files[run], self.tag_faults[run] = TagFile(), str(error)

    def records(self, run: str) -> Records:
        """Return the folder of a run's solved frames; nowhere if other settings override its own."""
        runs = Runs(self.runs[run].folder / "runs")

        def run_file(frame: str) -> Path | None:
            path = runs.path(frame)
            return path if path.is_file() and not self._overrides else None

        return run_file

    def loose_record(self, entry: GalleryEntry) -> Path | None:
        """Return the run file of an answer, in a folder of run files of any names; None in a batch."""
        row = entry.row
        return self._loose.get((entry.run, row.frame, row.method, row.seed))

    @cached_property
    def _loose(self) -> dict[tuple[str, str, str, int | None], Path]:
        files: dict[tuple[str, str, str, int | None], Path] = {}
        for run, index in self.runs.items():
            for path in () if (index.folder / RUN_FILE).is_file() else sorted(index.folder.glob(f"*{SUFFIX}")):
                with suppress(InputError):
                    end = read_run_file(path, with_iterations=False).end
                    for row in end.answers if end is not None else ():
                        files[run, row.frame, row.method, row.seed] = path
        return files

    @cached_property
    def folder(self) -> Path | None:
        """The folder of the run, or of all runs; None where it is not a folder of batches alone."""
        folders = [index.folder for index in self.runs.values()]
        if not all((folder / RUN_FILE).is_file() for folder in folders):
            return None
        parents = {folder.parent for folder in folders}
        return folders[0] if len(folders) == 1 else parents.pop() if len(parents) == 1 else None

    @cached_property
    def worst(self) -> GalleryEntry:
        """The answer that is opened first, one whose frame can be opened if possible."""
        ordered = self.sorted_by("error")
        return next((entry for entry in ordered if entry.can_be_opened), ordered[0])

    @cached_property
    def outcome(self) -> str:
        """How many objects are right, in words."""
        return outcome_words([entry.row for entry in self.entries], len(self.runs))

    @cached_property
    def doubt(self) -> str:
        """In how many frames the data are in doubt, and why; empty where none are."""
        return describe_doubts([(run, index.rows) for run, index in self.runs.items()])

    def sorted_by(self, order: Order) -> tuple[GalleryEntry, ...]:
        """All answers in one of ``batch.index.ORDERS``."""
        place = sort_key(order)
        return tuple(sorted(self.entries, key=lambda entry: place(entry.row)))

    @cached_property
    def first_filter(self) -> dict[str, str]:
        """The filter until the user chooses one: wrong answers, if any are known."""
        return {"result": WRONG} if any(entry.result == WRONG for entry in self.entries) else {}

    # Tags

    def tags_of(self, entry: GalleryEntry) -> tuple[str, ...]:
        return self._files[entry.run].tags.get(answer_key(entry.row), ())

    def tag(self, entries: Sequence[GalleryEntry], tag: str, on: bool) -> None:
        """Gives answers a tag, or takes it away; kept beside their runs.

        Raises:
            InputError: the tag is not one of the known ones, or a file is damaged or cannot be written.
        """
        tag = checked_name(tag)
        for run in dict.fromkeys(entry.run for entry in entries):
            tags = dict(self._files[run].tags)
            for key in (answer_key(entry.row) for entry in entries if entry.run == run):
                others = tuple(t for t in tags.pop(key, ()) if t != tag)
                if others or on:
                    tags[key] = (*others, tag) if on else others
            self._save(run, TagFile(tags))

    def _save(self, run: str, file: TagFile) -> None:
        if run in self.tag_faults:
            raise InputError(self.tag_faults[run])
        save_tags(self.runs[run].folder, file)
        self._files[run] = file

    def answer(self, key: int) -> GalleryEntry:
        """The answer with a number, in the order of :attr:`entries`.

        Raises:
            InputError: there is none.
        """
        if not 0 <= key < len(self.entries):
            raise InputError(unknown("answer", key, range(len(self.entries))))
        return self.entries[key]

    def session(self, run: str) -> Session:
        """The session that opens a run, with the frame of the worst object first."""
        if run not in self._sessions:
            index, overrides = self.runs[run], self._overrides
            session = load_session(index.folder / SESSION_FILE, overrides) if overrides else index.session
            scene = structs.replace(session.scene, frames=index.frames)
            self._sessions[run] = structs.replace(session, scene=scene)
        return self._sessions[run]


def outcome_words(rows: Sequence[Answer], n_runs: int) -> str:
    """How many objects of some answers are right; as in a batch, one without an answer is not."""
    solved = [row for row in rows if not row.is_waiting]
    objects = [row for row in solved if row.is_object]
    known = [row for row in objects if row.has_truth or row.is_correct is not None]
    n_right, missing = sum(row.is_correct is True for row in known), sum(row.status != "ok" for row in objects)
    n_seen = sum(row.is_correct is True or row.right_seen is True for row in known)
    n_frames, failed = len({row.frame for row in solved}), len(solved) - len(objects)
    words = f"{n_right} of {len(known)} right" if known else f"{len(objects)} objects"
    words += f", {n_seen} as far as the image shows," if n_seen > n_right else ""
    words += f" in {n_runs} runs" if n_runs > 1 else f" in {n_frames} frame{'s' * (n_frames != 1)}"
    unknown = [row for row in objects if row.status == "ok" and not row.can_be_right]
    words += f"; {len(unknown)} without ground truth" if known and unknown else ""
    impossible = sum(row.cause == Cause.IMPOSSIBLE for row in unknown)
    words += f"; {impossible} cannot stand as answered" if impossible else ""
    words += f"; {missing} {'has' if missing == 1 else 'have'} no answer" if missing else ""
    words += f"; {failed} frame{'s' * (failed != 1)} failed" if failed else ""
    n_waiting = len(rows) - len(solved)
    return words + (f"; {n_waiting} frame{'s' * (n_waiting != 1)} not solved yet" if n_waiting else "")


def read_gallery(folder: Path, overrides: Mapping[str, Any] | None = None) -> Gallery:
    """The batch run in ``folder``, or those of several that have a finished frame.

    Raises:
        InputError: there is none, none is finished, or a file is damaged.
    """
    folders = find_runs(folder).runs
    finished = [path for path in folders if has_finished_frame(path)]
    indices, notes = list[BatchIndex](), list[str]()
    for path in finished or folders[:1]:
        try:
            indices.append(read_batch(path))
        except InputError as error:
            notes.append(str(error))
    if not indices:
        raise InputError(notes[0])
    gallery = Gallery(indices, len(folders) - len(finished), overrides, notes)
    if not gallery.sorted_by("error"):
        raise InputError(f"no run in {folder} has an answer; open one by itself: verefine-viz view RUN{SUFFIX}")
    return gallery


def open_gallery(gallery: Gallery | None) -> Gallery:
    """Return the answers of the batch that is open.

    Raises:
        InputError: none is.
    """
    if gallery is None:
        raise InputError("no batch is open; open one with verefine-viz view FOLDER")
    return gallery
