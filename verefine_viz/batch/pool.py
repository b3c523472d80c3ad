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


def solve_frames(session: Session, frames: Sequence[str], out: Path, n_workers: int) -> Iterator[FrameResult]:
    """The results of ``frames``, in the order in which they are done."""
    waiting = deque(frames)
    workers: list[_Worker] = []
    try:
        while waiting and len(workers) < n_workers:
            workers.append(_started(session, out))
            workers[-1].give(waiting.popleft())
        while workers:
            ready = connection.wait([w.channel for w in workers])
            for worker in [w for w in workers if w.channel in ready]:
                try:
                    result, alive = worker.channel.recv(), True
                except (EOFError, OSError):
                    worker.process.join()
                    result, alive = failed_frame(worker.frame, _last_words(worker.process.exitcode)), False
                if not alive or not waiting:
                    workers.remove(worker)
                    worker.channel.close()
                    worker.process.join()
                if waiting:
                    if not alive:
                        worker = _started(session, out)
                        workers.append(worker)
                    worker.give(waiting.popleft())
                yield result
    finally:
        for worker in workers:
            worker.process.kill()
            worker.channel.close()
        for worker in workers:
            worker.process.join()


def _started(session: Session, out: Path) -> _Worker:
    # spawn: an OpenGL context does not survive a fork.
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=work, args=(theirs, session, out), daemon=True)
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
