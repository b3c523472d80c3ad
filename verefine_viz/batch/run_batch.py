"""One batch: every frame of a session, headless, resumable, on this machine or on a cluster.

Results are kept on the disk only: the parent's memory does not depend on how many frames there are.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import verefine_viz
from verefine_viz.batch.completeness import Written, look_at, write_tables
from verefine_viz.batch.folder import RunFolder
from verefine_viz.batch.journal import RUN_FILE, RunFile, RunTotals
from verefine_viz.batch.machine import (
    free_bytes,
    gigabytes,
    machine,
    own_peak_bytes,
    package_versions,
    temporary_folder,
)
from verefine_viz.batch.rows import FrameResult, with_objects
from verefine_viz.batch.tasks import TaskName, Workers
from verefine_viz.batch.totals import Counts
from verefine_viz.core.errors import InputError, SettingsError, UnavailableError, VerefineError, unknown
from verefine_viz.core.problem import LeftOut
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import first_of
from verefine_viz.observation.given_order import Entries, checked, read_orders
from verefine_viz.scenes.frames import frame_name, parse_frame
from verefine_viz.scenes.models import ModelLibrary
from verefine_viz.scenes.source import SceneSource
from verefine_viz.session.toolbox import Toolbox

# What can be known about a given order of objects before the first frame is read.


def check_orders(session: Session, frames: Sequence[str]) -> None:
    """Looks at the order that ``session`` gives for all frames, or at those that its file gives for ``frames``.

    Which objects and instances are in a frame is known when it is read; what does not fit it is noted then.

    Raises:
        InputError: the order file cannot be read.
        SettingsError: an order is malformed, runs in a circle, or names an object that the data set does not have.
    """
    settings = session.dependency
    if not (settings.order or settings.order_file):
        return
    known = _objects(session)
    if settings.order:
        _check(checked(settings.order, "dependency.order"), "dependency.order", known)
        return
    orders = read_orders(Path(settings.order_file))
    for frame in orders:
        try:
            known_as = frame_name(parse_frame(frame))
        except SettingsError as error:
            raise SettingsError(f"order file {settings.order_file}: {error}") from None
        if frame != known_as:
            raise SettingsError(f"order file {settings.order_file}: frame {frame!r} is called {known_as!r}; rename it")
    for frame in frames:
        if frame in orders:
            _check(orders[frame], f"order file {settings.order_file}, frame {frame!r}", known)


def _check(entries: Entries, where: str, known: Collection[int] | None) -> None:
    seen: set[int | str] = set()
    for entry in (entry for cluster in entries for entry in cluster):
        if known is not None and isinstance(entry, int) and entry not in known:
            raise SettingsError(f"{where}: {unknown('object', entry, sorted(known))}")
        if entry in seen:
            raise SettingsError(
                f"{where} runs in a circle: it names {entry!r} twice; name what carries others first, each once"
            )
        seen.add(entry)


def _objects(session: Session) -> Collection[int] | None:
    """The ids of all objects that can occur; None for built-in scenes."""
    scene = session.scene
    return set(ModelLibrary(Path(scene.dataset), scene.model_points, scene.seed).ids) if scene.source == "bop" else None


NEEDED_BYTES = 1_000_000
"""With less room than this on the disk, a frame fails because of it: a recording takes about as much."""
_MOST_DAMAGED = 3
"""Damaged entries of the journal that are quoted; the others are counted."""


@dataclass(frozen=True)
class Place:
    """Where and how frames are computed; the results do not depend on it."""

    n_workers: int = 1
    limit_bytes: int | None = None
    """Most memory of a worker process; None = its share of the machine's."""
    cluster: str = ""
    """Address of a Dask scheduler, or "local" for one of our own; empty = worker processes of this machine."""

    def workers(self, session: Session, out: Path, task: TaskName) -> Workers:
        """The workers; they may start at once.

        Raises:
            UnavailableError: the cluster does not answer, or its package is not installed.
        """
        if self.cluster:
            try:
                from verefine_viz.batch.cluster import open_cluster
            except ModuleNotFoundError as error:
                if error.name not in ("dask", "distributed"):
                    raise
                raise UnavailableError(
                    "--cluster needs Dask, which is not installed: pip install 'verefine-viz[cluster]'"
                ) from None
            return open_cluster(self.cluster, session, out, task, self.n_workers)
        from verefine_viz.batch.worker_pool import Pool

        return Pool(session, out, self.n_workers, task, self.limit_bytes)


@dataclass(frozen=True)
class Progress:
    """How far a batch is."""

    counts: Counts
    n_frames: int
    n_resumed: int
    """Frames that an earlier start had already finished."""
    seconds: float
    """Since this start."""
    frame_s: float | None = None
    """Time a frame takes, counted from the first one that was done: starting workers takes seconds."""
    warning: str = ""
    doing: str = ""
    """What takes longer than usual, or is worth knowing, in words, where it begins."""


@dataclass(frozen=True)
class Outcome:
    """How a batch ended."""

    folder: Path
    totals: dict[str, Any]
    """As in run.json."""
    failures: tuple[tuple[str, str], ...]
    """Frame and reason of the first failed frames."""
    n_resumed: int
    seconds: float
    memory: str
    """What it took, in words."""
    was_finished: bool = False
    """Nothing was left to do, and nothing was written."""
    faults: tuple[str, ...] = ()
    """What is not on the disk although the batch came to its end, a sentence each."""
    notes: tuple[str, ...] = ()
    """What else a person should know about what is on the disk: tables that were mended, recordings that are gone."""

    @property
    def is_whole(self) -> bool:
        """Whether every object was looked at, and every frame is in the journal and in the tables."""
        return not (self.n_failed or self.n_unreadable or self.faults)

    @property
    def n_failed(self) -> int:
        return self.totals["frames_failed"]

    @property
    def n_unreadable(self) -> int:
        """Objects, in frames that did not fail, whose model or mask is missing or damaged."""
        return self.totals["objects_unreadable"]


def check(session: Session) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The frames of a session and what a person should know about the choice, after everything in it that can be wrong
    was looked at once.

    Raises:
        VerefineError: the data set, a frame, the method, a given order or another name in the session is wrong, or the
            results files are of other frames or objects.
    """
    toolbox = Toolbox(session)
    frames = toolbox.frames
    if not frames:
        raise InputError("the session names no frames: the split and the targets file hold none")
    notes = (*toolbox.notes, *toolbox.source.check_initial_poses())
    check_orders(session, frames)
    _ = toolbox.method
    return frames, notes


def run_batch(
    session: Session,
    out: Path,
    place: Place,
    tell: Callable[[Progress], None] = lambda _: None,
    retry_failed: bool = False,
    task: TaskName = "solve",
    workers: Workers | None = None,
) -> Outcome:
    """Solves every frame of ``session`` into ``out``; goes on where an earlier start of the same batch stopped.

    The files are the same wherever frames are computed and however often it is interrupted, times aside. Those of a
    batch that is finished stay as they are.

    Args:
        session: what to run.
        out: the folder of the batch.
        place: where to compute.
        tell: told at the start, after each frame, and when something takes longer than usual.
        retry_failed: try frames again that failed in an earlier start, in which a file of an object could not be
            read, or whose recording is gone.
        task: what to do with each frame.
        workers: that stand ready for this session and folder, and are left running; None: some are started.

    Raises:
        VerefineError: the session or ``out`` cannot be used, or the cluster is gone. A frame that fails does not raise.
    """
    if workers is None:
        with closing(place.workers(session, out.absolute(), task)) as own:
            return run_batch(session, out, place, tell, retry_failed, task, own)
    frames, notes = check(session)
    with closing(RunFolder(out, session)) as folder:
        return _Batch(session, folder, frames, workers, place, notes, task).run(tell, retry_failed)


@dataclass
class _Batch:
    session: Session
    folder: RunFolder
    frames: Sequence[str]
    workers: Workers
    place: Place
    notes: Sequence[str]
    task: TaskName
    counts: Counts = field(default_factory=Counts)
    n_resumed: int = 0
    first_s: float = 0.0
    started: float = field(default_factory=time.perf_counter)
    begun: datetime = field(default_factory=lambda: datetime.now(UTC))

    def run(self, tell: Callable[[Progress], None], retry_failed: bool) -> Outcome:
        before, there = self.folder.read_run(), self._look()
        again = {*there.missing}
        if retry_failed:
            again |= {*there.can_be_mended, *there.without_recording}
        missing = [frame for frame in self.frames if frame in again]
        self.n_resumed = len(self.frames) - len(missing)
        self.counts = self._counts_without(missing) if retry_failed else there.totals.counts
        was_finished = before.status == "finished" and before.totals.frames == len(self.frames) and not there.missing
        if was_finished and not missing and not there.other_tables:
            return self._outcome(there, was_finished=True)
        mended = " and ".join(there.other_tables) if was_finished else ""
        spent_s = before.seconds if self.n_resumed else 0.0
        self._note("running", spent_s, {"frames": len(self.frames), "frames_done": self.n_resumed})
        try:
            tell(self._progress())
            for note in (*self.notes, *_damaged_entries(there)):
                tell(self._progress(f"note: {note}"))
            for result in self.workers.solve(missing):
                if isinstance(result, FrameResult):
                    self._keep(result)
                tell(self._progress(result if isinstance(result, str) else ""))
        except BaseException:
            # The disk may be the reason that it ends; then it is that reason that is told.
            with suppress(InputError):
                self._write_end("stopped", spent_s)
            raise
        return self._outcome(self._write_end("finished", spent_s), mended)

    def _look(self) -> Written:
        # Initial poses are not recorded.
        keep = "none" if self.task == "estimate" else self.session.recording.keep
        return look_at(self.folder.path, self.frames, keep)

    def _outcome(self, there: Written, mended: str = "", was_finished: bool = False) -> Outcome:
        totals = there.totals
        numbers, failures = totals.as_json(len(self.frames)), tuple(totals.failures)
        seconds, memory = self._seconds(), self._memory()
        notes = (f"written again from the journal, as it said something else: {mended}",) if mended else ()
        notes += (there.recordings_note,) if there.recordings_note else ()
        return Outcome(
            self.folder.path, numbers, failures, self.n_resumed, seconds, memory, was_finished, there.faults, notes
        )

    def _counts_without(self, frames: Sequence[str]) -> Counts:
        """Of the frames that are done and not to be solved again."""
        counts, again = Counts(), {*frames}
        for result in self.folder.journal.results(frame for frame in self.frames if frame not in again):
            counts.add(result)
        return counts

    def _keep(self, result: FrameResult) -> None:
        """
        Raises:
            InputError: a disk is full. A frame that failed for that alone is not noted as failed.
        """
        if result.failed:
            for folder in (self.folder.path, temporary_folder()):
                if free_bytes(folder) < NEEDED_BYTES:
                    raise InputError(
                        f"the disk of {folder} is full: frame {result.frame} failed, {result.objects[0].message}; "
                        "what is done is kept: make room and repeat the command"
                    )
            result = with_objects(result, self._objects_in(result))
        self.folder.journal.keep(result)
        self.counts.add(result)

    def _objects_in(self, failed: FrameResult) -> Sequence[LeftOut]:
        """What a failed frame would have held."""
        with suppress(VerefineError):
            return self._source.all_left_out(failed.frame, failed.objects[0].message)
        return ()

    @cached_property
    def _source(self) -> SceneSource:
        return Toolbox(self.session).source

    def _write_end(self, status: str, spent_s: float) -> Written:
        """Writes tables and run.json, and says what is on the disk then."""
        self.folder.save_session()  # Somebody may have deleted the folder meanwhile.
        write_tables(self.folder.path, self.frames)
        there = self._look()
        if status == "finished" and there.faults:
            status = "incomplete"
        self._note(status, spent_s, there.totals.as_json(len(self.frames)))
        return there

    def _note(self, status: str, spent_s: float, totals: dict[str, Any]) -> None:
        run = RunFile(
            version=verefine_viz.__version__,
            status=status,
            title=self.session.title,
            begun=self.begun.isoformat(timespec="seconds"),
            seconds=spent_s + self._seconds(),
            totals=RunTotals.model_validate(totals),
            workers=self.place.n_workers,
            cluster=self.place.cluster,
            memory=self._memory(),
            machine=machine(),
            packages=package_versions(),
        )
        self.folder.write_json(RUN_FILE, run.model_dump(exclude_unset=True))

    def _progress(self, doing: str = "") -> Progress:
        n_new, now_s, frame_s = self.counts.frames_done - self.n_resumed, self._seconds(), None
        if n_new == 1:
            self.first_s = now_s
        elif n_new > 1:
            frame_s = (now_s - self.first_s) / (n_new - 1)
        return Progress(self.counts, len(self.frames), self.n_resumed, now_s, frame_s, self.workers.warning, doing)

    def _seconds(self) -> float:
        return time.perf_counter() - self.started

    def _memory(self) -> str:
        parts = [self.workers.needs, f"{gigabytes(own_peak_bytes())} in the parent"]
        return " + ".join(part for part in parts if part)


def _damaged_entries(there: Written) -> tuple[str, ...]:
    """A note about entries of the journal that cannot be used; none where there are none."""
    n = len(there.damaged)
    if not n:
        return ()
    whose = "its frame is" if n == 1 else "these frames are"
    return (f"{first_of(there.damaged, _MOST_DAMAGED, '; ')}; {whose} solved again",)
