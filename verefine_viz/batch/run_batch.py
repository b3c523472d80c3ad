"""One batch: every frame of a session, headless, resumable, on this machine or on a cluster.

Results are on the disk only: the parent's memory does not depend on how many frames there are.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import msgspec

import verefine_viz
from verefine_viz.batch.completeness import BatchFiles, check_files, write_tables
from verefine_viz.batch.folder import RunFolder
from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.kept_recordings import KeptRecordings
from verefine_viz.batch.machine import (
    free_bytes,
    gigabytes,
    machine,
    own_peak_bytes,
    temporary_folder,
)
from verefine_viz.batch.motion_table import MOTION, MotionTrack, read_tracks
from verefine_viz.batch.runs import RUN_FILE, BatchInfo, RunTotals, read_run
from verefine_viz.batch.sequence_output import SequenceOutput, is_sequence
from verefine_viz.batch.session_check import check
from verefine_viz.batch.totals import BatchCounts
from verefine_viz.batch.worker_tasks import TaskName
from verefine_viz.core.errors import InputError, UnavailableError, VerefineError
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.problem import LeftOut
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import first_of
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_header import failed_run
from verefine_viz.run.session_parts import weights_of
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.run.versions import package_versions
from verefine_viz.scenes.source import SceneSource

NEEDED_BYTES = 1_000_000
"""With less free space than this on the disk, a frame fails because of it: a recording takes about as much."""
_MOST_DAMAGED = 3
"""Damaged run files that are quoted; the others are counted."""


class Workers(Protocol):
    """Where frames are solved: processes of this machine, or a cluster."""

    def solve(self, frames: Iterable[str], /) -> Iterator[RunRecord | str | None]:
        """The results of ``frames``, each once, in the order in which they are done; None where none came for a while.

        In between, once each, sentences on what takes longer than usual. The next of ``frames`` is taken when a worker
        is free, so there may be any number.
        """
        ...

    def close(self) -> None:
        """End the work, also in the middle of a frame."""
        ...

    @property
    def needs(self) -> str:
        """Memory that the workers need, in words; empty while unknown."""
        ...

    @property
    def warning(self) -> str:
        """Advice on the number of workers or their memory; empty where nothing is wrong."""
        ...


@dataclass(frozen=True)
class Backend:
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
        from verefine_viz.run.kernels_ahead import compile_ahead

        # The first worker compiles what it needs, and the others wait for it.
        compile_ahead(session)
        return Pool(FrameWork(session, out, task), self.n_workers, self.limit_bytes)


@dataclass(frozen=True)
class BatchStatus:
    """Progress of a batch."""

    counts: BatchCounts
    """Counts, with the frames that an earlier start finished."""
    n_frames: int
    warning: str = ""
    doing: str = ""
    """What begins to take longer than usual, or is worth knowing, in words; empty for most frames."""


@dataclass(frozen=True)
class BatchOutcome:
    """How a batch ended."""

    folder: Path
    totals: dict[str, Any]
    """Totals, as in run.json."""
    failures: tuple[tuple[str, str], ...]
    """Frame and reason of the first failed frames."""
    n_resumed: int
    seconds: float
    memory: str
    """Memory that workers and parent took, in words."""
    was_finished: bool = False
    """Whether nothing was left to do, so that nothing was written."""
    faults: tuple[str, ...] = ()
    """What is missing on the disk although the batch ran to its end, a sentence each."""
    notes: tuple[str, ...] = ()
    """What else to know about the files: tables that were written again, recordings that are gone."""

    motion: tuple[MotionTrack, ...] = ()
    """How objects moved, where the frames are a sequence."""

    @property
    def is_whole(self) -> bool:
        """Whether every object was read, and every frame is finished and in the tables."""
        return not (self.n_failed or self.n_unreadable or self.faults)

    @property
    def n_failed(self) -> int:
        return self.totals["frames_failed"]

    @property
    def n_unreadable(self) -> int:
        """Objects, in frames that did not fail, whose model or mask is missing or damaged."""
        return self.totals["objects_unreadable"]


def run_batch(
    session: Session,
    out: Path,
    backend: Backend,
    report: Callable[[BatchStatus], None] = lambda _: None,
    retry_failed: bool = False,
    task: TaskName = "solve",
    workers: Workers | None = None,
) -> BatchOutcome:
    """Solves every frame of ``session`` into ``out``; goes on where an earlier start of the same batch stopped.

    The files are the same wherever frames are computed and however often it is interrupted, times aside. Those of a
    batch that is finished stay as they are.

    Args:
        session: what to run.
        out: the folder of the batch.
        backend: where to compute.
        report: called at the start, after each frame, and when something takes longer than usual.
        retry_failed: try frames again that failed in an earlier start, in which a file of an object could not be
            read, or whose recording is gone.
        task: what to do with each frame.
        workers: ready for this session and folder, and left running; None: some are started, and closed at the end.

    Raises:
        VerefineError: the session or ``out`` cannot be used, or the cluster is gone. A frame that fails does not raise.
    """
    if workers is None:
        with closing(backend.workers(session, out.absolute(), task)) as own:
            return run_batch(session, out, backend, report, retry_failed, task, own)
    frames, notes = check(session)
    with closing(RunFolder(out, session)) as folder:
        batch = _Batch(session, folder, frames, workers, backend, notes, task)
        return batch.run(report, retry_failed)


@dataclass
class _Batch:
    session: Session
    folder: RunFolder
    frames: Sequence[str]
    workers: Workers
    backend: Backend
    notes: Sequence[str]
    task: TaskName
    counts: BatchCounts = field(default_factory=BatchCounts)
    n_resumed: int = 0
    started: float = field(default_factory=time.perf_counter)
    begun: datetime = field(default_factory=lambda: datetime.now(UTC))

    def run(self, report: Callable[[BatchStatus], None], retry_failed: bool) -> BatchOutcome:
        before, files = read_run(self.folder.path), self._check_files()
        again = {*files.missing}
        if retry_failed:
            again |= {*files.can_be_mended, *files.without_recording}
        if self.session.method.track:
            again |= _after(again, self.frames)
        in_order = sorted(self.frames, key=parse_frame) if self.session.method.track else self.frames
        missing = [frame for frame in in_order if frame in again]
        self.n_resumed = len(self.frames) - len(missing)
        is_again = retry_failed or self.session.method.track
        self.counts = self._counts_without(missing) if is_again else files.totals.counts
        was_finished = before.status == "finished" and before.totals.frames == len(self.frames) and not files.missing
        if was_finished and not missing and not files.other_tables:
            return self._outcome(files, was_finished=True)
        rewritten = " and ".join(files.other_tables) if was_finished else ""
        spent_s = before.seconds if self.n_resumed else 0.0
        self._note("running", spent_s, {"frames": len(self.frames), "frames_done": self.n_resumed})
        try:
            report(self._progress())
            for note in (*self.notes, *_damaged_entries(files)):
                report(self._progress(f"note: {note}"))
            for result in self.workers.solve(missing):
                if isinstance(result, RunRecord):
                    self._save(result)
                report(self._progress(result if isinstance(result, str) else ""))
            end = self._write_end("finished", spent_s)
        except BaseException:
            # Before what takes longer, or more room: a second Ctrl-C or a full disk may end it in there.
            self.folder.mark_stopped()
            # Where the disk is the reason that it ends, the first error is the one to report.
            with suppress(VerefineError):
                self._write_end("stopped", spent_s)
            raise
        return self._outcome(end, rewritten)

    def _check_files(self) -> BatchFiles:
        files = check_files(self.folder.path, self.frames, self._kept)
        if self._is_sequence and not (self.folder.path / MOTION).is_file():
            files = replace(files, other_tables=(*files.other_tables, MOTION))
        return files

    def _outcome(self, files: BatchFiles, rewritten: str = "", was_finished: bool = False) -> BatchOutcome:
        notes = (f"written again, as it differed from the run files: {rewritten}",) if rewritten else ()
        notes += (files.recordings_note,) if files.recordings_note else ()
        if not was_finished and self._kept.keep == "sample" and files.n_not_kept:
            notes += (_sampled_note(files, self.folder.path),)
        return BatchOutcome(
            folder=self.folder.path,
            totals=files.totals.as_json(len(self.frames)),
            failures=tuple(files.totals.failures),
            n_resumed=self.n_resumed,
            seconds=self._seconds(),
            memory=self._memory(),
            was_finished=was_finished,
            faults=files.faults,
            notes=notes,
            motion=read_tracks(self.folder.path),
        )

    def _counts_without(self, frames: Sequence[str]) -> BatchCounts:
        """Counts of the frames that are done and not to be solved again."""
        counts, again = BatchCounts(), {*frames}
        for record in self.folder.runs.records(frame for frame in self.frames if frame not in again):
            if record.end is not None:
                counts.add(record.end)
        return counts

    def _save(self, record: RunRecord) -> None:
        """Count a frame that is over; the record of one that failed is written here, others have theirs already.

        Raises:
            InputError: a disk is full. A frame that failed for that alone is not noted as failed.
        """
        frame, end = record.header.frame, record.end
        assert end is not None
        if end.failed:
            for folder in (self.folder.path, temporary_folder()):
                if free_bytes(folder) < NEEDED_BYTES:
                    raise InputError(
                        f"the disk of {folder} is full: frame {frame} failed, {end.answers[0].message}; "
                        "what is done is saved: free some space and repeat the command"
                    )
            message = end.answers[0].message
            record = failed_run(self.session, self._weights, frame, message, self._objects_in(frame, message))
            self.folder.runs.save(self.session, record)
        assert record.end is not None
        self.counts.add(record.end)

    def _objects_in(self, frame: str, why: str) -> Sequence[LeftOut]:
        """The objects of a failed frame, as far as its source knows them."""
        with suppress(VerefineError):
            return self._source.all_left_out(frame, why)
        return ()

    @cached_property
    def _weights(self) -> dict[str, str]:
        return weights_of(self.session)

    @cached_property
    def _source(self) -> SceneSource:
        return Toolbox(self.session).source

    @cached_property
    def _kept(self) -> KeptRecordings:
        kept = KeptRecordings.of(self.session, len(self.frames))
        # Initial poses are not recorded.
        return replace(kept, keep="none") if self.task == "estimate" else kept

    @cached_property
    def _is_sequence(self) -> bool:
        return self.task != "estimate" and is_sequence(self.session, self._source)

    def _write_end(self, status: str, spent_s: float) -> BatchFiles:
        """Write tables and run.json; return what the folder then holds."""
        self.folder.save_session()  # The folder may have been deleted while the batch ran.
        files = write_tables(self.folder.path, self.frames, self._kept)
        if self._is_sequence:
            output = SequenceOutput(self.folder.path, self._source)
            output.write_table(self.frames)
            if status == "finished" and self.session.recording.keep != "none":
                output.write_recording(self.session.title)
        if status == "finished" and files.faults:
            status = "incomplete"
        self._note(status, spent_s, files.totals.as_json(len(self.frames)))
        return files

    def _note(self, status: str, spent_s: float, totals: dict[str, Any]) -> None:
        run = BatchInfo(
            version=verefine_viz.__version__,
            status=status,
            title=self.session.title,
            begun=self.begun.isoformat(timespec="seconds"),
            seconds=spent_s + self._seconds(),
            totals=msgspec.convert(totals, RunTotals),
            workers=self.backend.n_workers,
            cluster=self.backend.cluster,
            memory=self._memory(),
            machine=machine(),
            packages=package_versions(),
            weights=self._weights,
        )
        self.folder.write_json(RUN_FILE, msgspec.to_builtins(run))

    def _progress(self, doing: str = "") -> BatchStatus:
        return BatchStatus(self.counts, len(self.frames), self.workers.warning, doing)

    def _seconds(self) -> float:
        return time.perf_counter() - self.started

    def _memory(self) -> str:
        parts = [self.workers.needs, f"{gigabytes(own_peak_bytes())} in the parent"]
        return " + ".join(part for part in parts if part)


def _after(frames: Collection[str], all_frames: Sequence[str]) -> set[str]:
    """The frames that come after ``frames`` in their scenes: they began with answers that will now be others."""
    scenes, after = set[int](), set[str]()
    for frame in sorted(all_frames, key=parse_frame):
        scene = parse_frame(frame)[0]
        if scene in scenes:
            after.add(frame)
        if frame in frames:
            scenes.add(scene)
    return after


def _sampled_note(files: BatchFiles, folder: Path) -> str:
    """A note on the disk space that is saved as not every frame is recorded, and how to get the other recordings."""
    each_bytes = files.recorded_bytes / max(files.n_recorded, 1)
    saves = f", which saves about {gigabytes(int(each_bytes * files.n_not_kept))}" if files.n_recorded else ""
    return (
        f"{files.n_recorded} frames have a recording, failures and a sample{saves}; --recording.keep all keeps them "
        f"all, and verefine-viz replay {folder} --draw makes the other {files.n_not_kept} from the run files"
    )


def _damaged_entries(files: BatchFiles) -> tuple[str, ...]:
    """Notes about run files that cannot be used."""
    n = len(files.damaged)
    if not n:
        return ()
    whose = "its frame is" if n == 1 else "these frames are"
    return (f"{first_of(files.damaged, _MOST_DAMAGED, '; ')}; {whose} solved again",)
