"""Worker processes, a frame each at a time. One that dies takes only its frame with it."""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import connection, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path

from verefine_viz.batch.rows import FrameResult, failed_frame
from verefine_viz.batch.worker import work
from verefine_viz.core.settings import Session


@dataclass
class _Worker:
    process: BaseProcess
    channel: connection.Connection
    frame: str = ""

    def give(self, frame: str) -> None:
        self.frame = frame
        # If the process has just died, the channel says so when it is read.
        with suppress(OSError):
            self.channel.send(frame)

    def result(self) -> FrameResult:
        """What it found, or how it died."""
        try:
            return self.channel.recv()
        except (EOFError, OSError):
            self.channel.close()
            self.process.join()
            return failed_frame(self.frame, _last_words(self.process.exitcode))


class Pool:
    """Workers for one session. The first starts at once, so that it imports and compiles while others prepare."""

    def __init__(self, session: Session, out: Path, n_workers: int) -> None:
        self._session, self._out, self._n_workers = session, out, n_workers
        self._workers = [self._started()]

    def solve(self, frames: Sequence[str]) -> Iterator[FrameResult]:
        """The results of ``frames``, in the order in which they are done."""
        waiting = deque(frames)
        while len(self._workers) < min(self._n_workers, len(frames)):
            self._workers.append(self._started())
        busy = [worker for worker, _ in zip(self._workers, frames, strict=False)]
        for worker in busy:
            worker.give(waiting.popleft())
        while busy:
            ready = connection.wait([worker.channel for worker in busy])
            for worker in [w for w in busy if w.channel in ready]:
                busy.remove(worker)
                result = worker.result()
                if waiting:
                    heir = worker if worker.process.is_alive() else self._replaced(worker)
                    heir.give(waiting.popleft())
                    busy.append(heir)
                yield result

    def close(self) -> None:
        """Ends all workers, also in the middle of a frame."""
        for worker in self._workers:
            worker.process.kill()
            worker.channel.close()
        for worker in self._workers:
            worker.process.join()
        self._workers = []

    def _replaced(self, dead: _Worker) -> _Worker:
        self._workers[self._workers.index(dead)] = heir = self._started()
        return heir

    def _started(self) -> _Worker:
        # spawn: an OpenGL context does not survive a fork.
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=work, args=(theirs, self._session, self._out), daemon=True)
        with _interrupts_ignored():
            process.start()
        theirs.close()
        return _Worker(process, ours)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Processes started inside do not react to Ctrl-C; this process ends them."""
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
