"""A folder in which frames arrive: which there are, and a batch per data set of it that solves them as they come.

The folder is a data set in BOP layout (what ``Frame.keep`` writes is one), or holds several. Each gets a run of its
own below ``out``, with the files of any batch: a watch that is killed goes on where it was, and ``view`` opens what it
left.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from msgspec import structs

from verefine_viz.batch.folder import SESSION_FILE, RunFolder
from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.motion_table import MotionTrack, motion_rows, tracks_of
from verefine_viz.batch.run_batch import Backend, BatchStatus, run_batch
from verefine_viz.batch.runs import BatchInfo, Runs
from verefine_viz.batch.sequence_output import SequenceOutput, is_sequence
from verefine_viz.batch.worker_pool import Pool
from verefine_viz.core.errors import InputError, UnavailableError, VerefineError, one_line
from verefine_viz.core.frame_names import frame_name, parse_frame
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import check_folder, check_no_link, try_lock
from verefine_viz.run.data_folder import CAMERAS, SCENES, data_at, holds_frames
from verefine_viz.run.record import WAITING, Answer, RunRecord, awaited
from verefine_viz.run.session_file import load_session, save_session
from verefine_viz.scenes.source import open_scene
from verefine_viz.scenes.trace_files import is_trace, traces_in, written_ns

_LOG = logging.getLogger(__name__)
POLL_S = 1.0
"""Time between two looks into the folder [s]."""
TRIES = 3
"""How often a frame is tried that fails, or has a file that cannot be read, as it may still be being written."""
RETRY_S = 3.0
"""Time between two tries [s]."""
LOCK = ".watch.lock"


@dataclass(eq=False)
class WatchedDataset:
    """One data set of the folder, and its run."""

    out: Path
    """Folder of the run."""
    session: Session
    frames: tuple[str, ...] = ()
    """Frames of the data set, in the order in which they arrived."""
    results: dict[str, RunRecord] = field(default_factory=dict)
    """Records of frames that are solved, or given up after several tries."""
    tries: dict[str, int] = field(default_factory=dict)
    begun_ns: dict[str, int] = field(default_factory=dict)
    """When a frame was last given to a worker [ns since 1970]."""
    not_before: dict[str, float] = field(default_factory=dict)
    """When a frame that failed may be tried again [s]."""
    blocked_until: float = 0.0
    """When a session that could not be run is tried again [s]."""
    shapes: SequenceOutput | None = None
    """What is known of the objects' shapes; None where the frames are no sequence."""
    written: tuple[str, ...] = ()
    """Frames that are in the run's tables."""
    files: object = None
    """State of the data set's files when they were read: see :func:`_state_of`."""

    @property
    def waiting(self) -> tuple[str, ...]:
        """Frames that are still to be solved."""
        return tuple(frame for frame in self.frames if frame not in self.results)

    @property
    def ready(self) -> tuple[str, ...]:
        """Frames that can be solved now."""
        now = time.monotonic()
        return tuple(frame for frame in self.waiting if self.not_before.get(frame, 0.0) <= now)

    @property
    def has_work(self) -> bool:
        """Whether something is to be solved or written now."""
        return time.monotonic() >= self.blocked_until and bool(self.ready or self.written != self.frames)

    @property
    def index(self) -> BatchIndex:
        """The batch for the gallery: answers in the order in which they came, then a row per waiting frame."""
        there = {*self.frames}
        done = [row for frame, result in self.results.items() if frame in there for row in _answers(result)]
        rows = (*done, *map(self._waiting_row, self.waiting))
        motion = partial(_tracks, self.frames, {**self.results}, self.shapes)
        return BatchIndex(self.out, self.session, BatchInfo(), rows, motion=motion)

    def _waiting_row(self, frame: str) -> Answer:
        return Answer(frame=frame, status="no_answer", method=self.session.method.name, message=WAITING)

    def grown(self, runs: Runs, written: Mapping[int, int]) -> tuple[str, ...]:
        """Finished frames whose traces grew after they were begun, by when each trace was written [ns since 1970]."""
        changed = {frame_name((0, number)): at for number, at in written.items()}
        paths = {frame: runs.path(frame) for frame in self.frames if frame in changed}
        begun = {f: self.begun_ns.get(f) or path.stat().st_mtime_ns for f, path in paths.items() if path.exists()}
        at_work = {f for f in begun if f not in self.results and f in self.begun_ns}
        return tuple(frame for frame, at in begun.items() if changed[frame] > at and frame not in at_work)

    def forget(self, runs: Runs, frame: str) -> None:
        """Drop the results of a frame, so that it is solved again."""
        runs.forget(frame)
        for known in (self.results, self.tries, self.begun_ns, self.not_before):
            known.pop(frame, None)

    def take(self, runs: Runs, result: RunRecord) -> None:
        """Take over a result, or try the frame again where its files may not have been whole."""
        frame = result.header.frame
        tries = self.tries.get(frame, 0)
        if result.end is not None and result.end.can_be_mended and tries < TRIES:
            runs.forget(frame)
            self.not_before[frame] = time.monotonic() + RETRY_S if tries else 0.0
        else:
            self.results[frame] = result


def _tracks(
    frames: Sequence[str], results: Mapping[str, RunRecord], shapes: SequenceOutput | None
) -> tuple[MotionTrack, ...]:
    """How objects move over solved and waiting frames; empty where these are no sequence."""
    if shapes is None:
        return ()
    records = (results.get(frame) or awaited(frame) for frame in sorted(frames, key=parse_frame))
    return tracks_of(motion_rows(records, shapes))


def _answers(record: RunRecord) -> tuple[Answer, ...]:
    return () if record.end is None else record.end.answers


class Watch:
    """Looks into a folder and solves what it finds; all but :attr:`latest` and :meth:`stop` belongs to one thread.

    Args:
        folder: what is watched.
        out: gets a folder per data set.
        base: whose method and other settings are used; None = those of a data set's own ``session.toml``, or defaults.
        overrides: settings that win over those.
        n_workers: processes that solve.

    Raises:
        InputError: the folder does not exist, or ``out`` cannot be written.
        UnavailableError: another program watches with the same ``out``.
    """

    def __init__(
        self,
        folder: Path,
        out: Path,
        base: Session | None = None,
        overrides: Mapping[str, Any] | None = None,
        n_workers: int = 1,
    ) -> None:
        if not folder.is_dir():
            what = "is a file" if folder.exists() else "does not exist"
            raise InputError(f"--watch {folder} {what}; expected the folder in which frames arrive")
        check_folder(out)
        out.mkdir(parents=True, exist_ok=True)
        lock = try_lock(out / LOCK)
        if lock is None:
            raise UnavailableError(f"another program watches with its results in {out}; end it or choose another --out")
        self.folder, self.out = folder, out
        self._lock = lock
        self._base, self._overrides, self._n_workers = base, overrides or {}, n_workers
        self._watched: dict[Path, WatchedDataset] = {}
        self._faults: dict[Path, str] = {}
        self._pool: Pool[str, RunRecord] | None = None
        self._stopping = threading.Event()
        self._changed: Callable[[], None] = lambda: None
        self._looked_at = 0.0
        self.latest: tuple[tuple[BatchIndex, ...], str] = ((), "")
        """A run per data set that has or had frames, and what keeps frames from being read or solved, one line."""

    def look(self) -> bool:
        """Look for frames that arrived, were solved or are gone; return whether anything changed."""
        self._looked_at = time.monotonic()
        folders = data_folders(self.folder)
        for data, watched in self._watched.items():
            if data not in folders:
                watched.frames, watched.files = (), None
        self._faults = {data: fault for data, fault in self._faults.items() if data in self._watched}
        for data in folders:
            try:
                self._read(data)
            except Exception as error:  # A file may still be being written.
                self._faults[data] = _described(error)
        before, self.latest = (
            self.latest,
            (
                tuple(watched.index for watched in self._watched.values()),
                "; ".join(self._faults.values()),
            ),
        )
        for fault in {*self._faults.values()} - {*before[1].split("; ")}:
            _LOG.warning("%s", fault)
        return _shown(before) != _shown(self.latest)

    def work(self, changed: Callable[[], None]) -> None:
        """Look and solve until :meth:`stop`; ``changed`` is called after each change."""
        self._changed = changed
        with suppress(_Stopped):
            while not self._stopping.wait(max(self._looked_at + POLL_S - time.monotonic(), 0)):
                try:
                    self._poll()
                    # While one is solved others may arrive.
                    for data, watched in [*self._watched.items()]:
                        if watched.has_work:
                            self._solve(data, watched)
                except Exception as error:
                    self.latest = self.latest[0], _described(error)

    def stop(self) -> None:
        """End :meth:`work` within a second or two. Callable from any thread."""
        self._stopping.set()

    def close(self) -> None:
        """End the workers and remove half-written files. Not while :meth:`work` runs."""
        if self._pool is not None:
            self._pool.close()
        for watched in self._watched.values():
            if (watched.out / SESSION_FILE).exists():
                with suppress(VerefineError):
                    RunFolder(watched.out, watched.session).close()
        self._lock.close()

    def _poll(self) -> None:
        if self.look():
            self._changed()

    def _read(self, data: Path) -> None:
        """Read which frames a data set has now, and which of them are solved.

        Raises:
            VerefineError: a file of it is damaged, or not whole yet.
        """
        watched, files = self._watched.get(data), _state_of(data)
        if watched is None or watched.files != files:
            session = self._session(data)
            source = open_scene(session.scene, session.hypotheses)
            frames = source.frames
            if watched is None:
                taken = {other.out.name for other in self._watched.values()}
                out = self.out / _free(data.resolve().name, taken)
                check_no_link(out)
                watched = self._watched[data] = WatchedDataset(out, session)
            if session != watched.session:
                watched.session = session
            watched.shapes = SequenceOutput(watched.out, source) if is_sequence(session, source) else None
            there = {*frames}
            watched.frames = tuple(dict.fromkeys((*(f for f in watched.frames if f in there), *frames)))
            watched.files = files
            self._faults.pop(data, None)
        runs = Runs(watched.out / "runs")
        for frame in watched.grown(runs, written_ns(data)):
            watched.forget(runs, frame)
        for result in runs.records(watched.waiting):
            watched.take(runs, result)

    def _session(self, data: Path) -> Session:
        """The session that solves a data set: all of its frames, whatever frames its session file names."""
        own, base, title = data / SESSION_FILE, self._base, data.resolve().name
        if own.is_file():
            session = load_session(own, self._overrides)
        elif base is not None and base.scene.source == "bop" and any(data.glob(f"{SCENES}/{CAMERAS}")):
            scene = structs.replace(base.scene, dataset=str(data.resolve()))
            session = structs.replace(base, title=title, scene=scene)
        else:
            known = data_at(data, self._overrides)
            if known is None:
                raise InputError(f"{data} holds no frame any more")
            session = known.session
        if base is not None:
            data_of = {"title": session.title, "scene": session.scene, "hypotheses": session.hypotheses}
            session = structs.replace(base, **data_of)
        scene = structs.replace(session.scene, frames=())
        return structs.replace(session, scene=scene, edits=())

    def _solve(self, data: Path, watched: WatchedDataset) -> None:
        """Solve the ready frames of a data set, and those that arrive meanwhile; then write its tables."""
        session, frames, out = watched.session, watched.frames, watched.out.absolute()
        try:
            _accept_growth(watched)
            work = FrameWork(session, out, "explain")
            if self._pool is None:
                self._pool = Pool(work, self._n_workers, pause_s=POLL_S)
            self._pool.switch_to(work)
            workers = _Newest(self._pool, watched)
            run_batch(session, watched.out, Backend(self._n_workers), self._report, workers=workers)
            watched.written = frames
            self._faults.pop(data, None)
        except Exception as error:
            if self._pool is not None:  # Its workers may still be at frames of this round.
                self._pool.close()
                self._pool = None
            self._faults[data] = _described(error)
            watched.blocked_until = time.monotonic() + 3 * RETRY_S
        self._poll()

    def _report(self, progress: BatchStatus) -> None:
        """Look into the folder between results, as frames arrive while others are solved."""
        if self._stopping.is_set():
            raise _Stopped
        self._poll()


class _Stopped(BaseException):
    """Raised inside a batch to end the watch."""


@dataclass(frozen=True)
class _Newest:
    """Workers that solve the newest frame first, frames that arrive meanwhile included; where objects are tracked, the
    oldest first.
    """

    pool: Pool[str, RunRecord]
    watched: WatchedDataset

    def solve(self, frames: Iterable[str]) -> Iterator[RunRecord | str | None]:
        return self.pool.solve(self._wanted(self.watched.session))

    def _wanted(self, session: Session) -> Iterator[str]:
        """Frames to solve, until none is ready or the session has changed."""
        given = set[str]()
        while self.watched.session is session:
            ready = [frame for frame in self.watched.ready if frame not in given]
            if not ready:
                return
            frame = ready[0] if session.method.track else ready[-1]
            given.add(frame)
            self.watched.tries[frame] = self.watched.tries.get(frame, 0) + 1
            self.watched.begun_ns[frame] = time.time_ns()
            yield frame

    def close(self) -> None:
        """Do nothing: the workers are used again."""

    @property
    def needs(self) -> str:
        return self.pool.needs

    @property
    def warning(self) -> str:
        return self.pool.warning


def _described(error: Exception) -> str:
    if isinstance(error, VerefineError):
        return str(error)
    _LOG.error("unforeseen", exc_info=error)
    return f"{type(error).__name__}: {one_line(str(error))}"


def data_folders(folder: Path) -> tuple[Path, ...]:
    """The data sets of a folder that hold a frame: itself, or those directly in it. Traces in it are its own."""
    try:
        if holds_frames(folder):
            return (folder,)
        inside = (path for path in folder.iterdir() if path.is_dir() and not is_trace(path))
        return tuple(sorted(path for path in inside if holds_frames(path)))
    except OSError:  # It is gone, or a folder in it is.
        return ()


def _state_of(data: Path) -> object:
    """Time and size of the files that say which frames there are and how to read them."""
    files = sorted((data / SESSION_FILE, *data.glob(f"{SCENES}/{CAMERAS}")))
    stats = [(file, file.stat()) for file in files if file.is_file()]
    return (
        traces_in(data),
        tuple(written_ns(data).items()),
        tuple((file, stat.st_mtime_ns, stat.st_size) for file, stat in stats),
    )


def _free(name: str, taken: Iterable[str]) -> str:
    names = (name, *(f"{name}-{k}" for k in range(2, len([*taken]) + 3)))
    return next(free for free in names if free not in taken)


def _shown(latest: tuple[tuple[BatchIndex, ...], str]) -> object:
    # What is solved is read once and kept; a frame that waits has another row each time.
    return [
        (index.folder, index.session, [row.frame if row.is_waiting else id(row) for row in index.rows])
        for index in latest[0]
    ], latest[1]


def _accept_growth(watched: WatchedDataset) -> None:
    """Lets a run go on with the session that ``Frame.keep`` wrote with later frames.

    Further results files, more poses per object, and gravity that later frames know do not change what earlier frames
    have to be solved with.
    """
    file = watched.out / SESSION_FILE
    if not file.exists():
        return
    before, now = load_session(file), watched.session
    files, most = now.hypotheses.files, now.hypotheses.max_per_object
    grown = structs.replace(
        before,
        scene=structs.replace(before.scene, gravity=now.scene.gravity),
        hypotheses=structs.replace(before.hypotheses, files=files, max_per_object=most),
    )
    keeps_files = {*before.hypotheses.files} <= {*now.hypotheses.files}
    if before != now and grown == now and keeps_files:
        save_session(now, file)
