"""Worker processes, a frame each at a time. One that dies takes at most its frame with it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import connection, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from time import monotonic

from verefine_viz.batch.frame_queue import FrameQueue
from verefine_viz.batch.machine import SHARE, gigabytes, machine_bytes, peak_bytes, resident_bytes
from verefine_viz.batch.pace import Pace
from verefine_viz.batch.worker_process import work
from verefine_viz.batch.worker_tasks import TaskName
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunRecord, failed_run

TRIES = 2
"""How often a frame is given out whose worker dies: the reason may have been another process (out of memory)."""


@dataclass
class _Worker:
    process: BaseProcess
    channel: connection.Connection
    session: Session
    out: Path
    """Folder of the batch."""
    frame: str = ""

    def give(self, frame: str, session: Session, out: Path) -> None:
        self.frame = frame
        # If the process has just died, reading the channel will show it.
        with suppress(OSError):
            if (self.session, self.out) != (session, out):
                self.channel.send((session, out))
            self.channel.send(frame)
        self.session, self.out = session, out

    def answer(self) -> RunRecord | str | None:
        """Its result, or a sentence on what is taking long; None where it died instead."""
        try:
            return self.channel.recv()
        except (EOFError, OSError):
            self.channel.close()
            self.process.join()
            return None

    def kill(self) -> None:
        self.process.kill()
        self.channel.close()


class Pool:
    """Workers for one session at a time. The first starts at once, so that it imports while others prepare.

    Args:
        session: what they work on.
        out: the folder of the batch.
        n_workers: most processes at a time.
        task: what they do with each frame.
        limit_bytes: a worker that holds more than this after a frame is replaced by a new one; None: its share of
            the machine's memory.
        pause_s: most time between two results, or None in their place [s]; None: they come when they come.
    """

    def __init__(
        self,
        session: Session,
        out: Path,
        n_workers: int,
        task: TaskName = "solve",
        limit_bytes: int | None = None,
        pause_s: float | None = None,
    ) -> None:
        self._pause_s = pause_s
        self._session, self._out, self._n_workers, self._task = session, out, n_workers, task
        self._given_limit_bytes = limit_bytes
        self._peak_bytes = 0
        self._n_renewed = 0
        self._most_workers = 1
        self._tries: dict[str, int] = {}
        self._reported: set[str] = set()
        self._workers = [self._started()]

    @property
    def needs(self) -> str:
        return f"{self._most_workers} × {gigabytes(self._peak_bytes)} in workers" if self._peak_bytes else ""

    @property
    def warning(self) -> str:
        if self._peak_bytes <= self._limit_bytes:
            return ""
        renewed = f"{self._n_renewed} {'was' if self._n_renewed == 1 else 'were'}"
        return (
            f"a worker needs {gigabytes(self._peak_bytes)}, and {self._most_workers} of them may take "
            f"{gigabytes(self._limit_bytes)} each: {renewed} restarted to free memory; "
            "fewer --workers, or a higher --worker-memory-gb, is faster"
        )

    @property
    def _limit_bytes(self) -> int:
        """What a worker may hold: they share the memory, and there are no more of them than frames."""
        return self._given_limit_bytes or int(SHARE * machine_bytes() / self._most_workers)

    def switch_to(self, session: Session, out: Path) -> None:
        """From now on frames are those of another batch; processes stay, which saves seconds of imports each."""
        self._session, self._out = session, out
        self._tries.clear()

    def solve(self, frames: Iterable[str], pace: Pace | None = None) -> Iterator[RunRecord | str | None]:
        """See :class:`verefine_viz.batch.run_batch.Workers`."""
        in_order, pace = self._session.method.track, pace or Pace()
        queue = FrameQueue(frames, in_order)
        idle, busy = list(self._workers), list[_Worker]()

        def give_out() -> None:
            while len(busy) < self._n_workers:
                frame = queue.take([worker.frame for worker in busy])
                if frame is None:
                    return
                busy.append(idle.pop() if idle else self._added())
                busy[-1].give(frame, self._session, self._out)
                pace.begin(frame, monotonic())

        give_out()
        while busy:
            ready = connection.wait([worker.channel for worker in busy], self._pause_s)
            if not ready:
                yield None
            for worker in [w for w in busy if w.channel in ready]:
                result = worker.answer()
                if isinstance(result, str):
                    pace.slow_down(worker.frame, result)
                    if result not in self._reported:
                        self._reported.add(result)
                        yield result
                    continue
                busy.remove(worker)
                pace.end(worker.frame, monotonic(), result and result.end)
                if result is not None and self._fits(worker):
                    idle.append(worker)
                else:
                    self._remove(worker)
                if result is None and self._may_try_again(worker.frame):
                    queue.again(worker.frame)
                elif result is None:
                    result = failed_run(self._session, worker.frame, _last_words(worker.process.exitcode))
                if in_order and result is not None:
                    yield result  # The frame after it finds its answers on the disk.
                give_out()
                if not in_order and result is not None:
                    yield result

    def close(self) -> None:
        """Ends all workers, also in the middle of a frame."""
        for worker in self._workers:
            worker.kill()
        for worker in self._workers:
            worker.process.join()
        self._workers = []

    def _may_try_again(self, frame: str) -> bool:
        self._tries[frame] = self._tries.get(frame, 0) + 1
        return self._tries[frame] < TRIES

    def _fits(self, worker: _Worker) -> bool:
        pid = worker.process.pid
        if pid is None:
            return True
        self._peak_bytes = max(self._peak_bytes, peak_bytes(pid) or 0)
        fits = (resident_bytes(pid) or 0) <= self._limit_bytes
        self._n_renewed += not fits
        return fits

    def _remove(self, worker: _Worker) -> None:
        worker.kill()
        worker.process.join()
        self._workers.remove(worker)

    def _added(self) -> _Worker:
        self._workers.append(self._started())
        self._most_workers = max(self._most_workers, len(self._workers))
        return self._workers[-1]

    def _started(self) -> _Worker:
        # spawn: an OpenGL context does not survive a fork.
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=work, args=(theirs, self._session, self._out, self._task), daemon=True)
        with interrupts_ignored():
            process.start()
        theirs.close()
        return _Worker(process, ours, self._session, self._out)


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """Processes started inside do not react to Ctrl-C; this process ends them.

    A thread beside the main one cannot see to that: they ignore it themselves once they run.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _last_words(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        return (
            f"the worker process was killed by {signal.Signals(-exit_code).name} (out of memory, or a library crashed)"
        )
    return f"the worker process ended with exit code {exit_code}"
