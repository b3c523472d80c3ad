"""Worker processes that solve one item at a time, such as a frame; a worker that dies loses at most its item."""

from __future__ import annotations

import signal
import threading
from collections.abc import Hashable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import connection, get_context
from multiprocessing.process import BaseProcess
from typing import Generic, TypeVar

from verefine_viz.batch.machine import SHARE, gigabytes, machine_bytes, peak_bytes, resident_bytes
from verefine_viz.batch.work_queue import WorkQueue
from verefine_viz.batch.worker_process import work
from verefine_viz.batch.worker_tasks import Work

Item = TypeVar("Item", bound=Hashable)
Result = TypeVar("Result")

TRIES = 2
"""How often an item is given out whose worker dies: another process may have been the reason (out of memory)."""


@dataclass(eq=False)
class _Worker(Generic[Item, Result]):
    process: BaseProcess
    channel: connection.Connection
    work: Work[Item, Result] | None = None

    def give(self, work: Work[Item, Result], item: Item | None) -> None:
        """Have the worker solve an item, or only make the tools of a work."""
        # If the process has just died, reading the channel will show it.
        with suppress(OSError):
            self.channel.send((None if self.work == work else work, item))
        self.work = work

    def answer(self) -> Result | str | None:
        """The worker's result, or a sentence on what takes long; None where the worker died."""
        try:
            return self.channel.recv()
        except (EOFError, OSError):
            self.channel.close()
            self.process.join()
            return None

    def kill(self) -> None:
        self.process.kill()
        self.channel.close()


class Pool(Generic[Item, Result]):
    """Workers for one work at a time. The first starts at once, so that it imports while others prepare.

    Args:
        work: what workers do with each item.
        n_workers: most processes at a time.
        limit_bytes: a worker that holds more than this after an item is replaced by a new one; None: its share of
            the machine's memory.
        pause_s: after so long without a result, ``solve`` yields None in its place [s]; None: it waits for results.
    """

    def __init__(
        self,
        work: Work[Item, Result],
        n_workers: int,
        limit_bytes: int | None = None,
        pause_s: float | None = None,
    ) -> None:
        self._pause_s = pause_s
        self._work, self._n_workers = work, n_workers
        self._given_limit_bytes = limit_bytes
        self._peak_bytes = 0
        self._n_renewed = 0
        self._most_workers = 1
        self._tries: dict[Item, int] = {}
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
        """Most memory of a worker [bytes]: an equal share, of no more workers than there are items."""
        return self._given_limit_bytes or int(SHARE * machine_bytes() / self._most_workers)

    def switch_to(self, work: Work[Item, Result]) -> None:
        """Take items of another work from now on; the processes stay, which saves each seconds of imports."""
        self._work = work
        self._tries.clear()

    def solve(self, items: Iterable[Item]) -> Iterator[Result | str | None]:
        """The results of ``items``: see :class:`verefine_viz.batch.run_batch.Workers`."""
        of = self._work
        queue = WorkQueue(items, of.line_of)
        idle, busy = list(self._workers), dict[_Worker[Item, Result], Item]()

        def give_out() -> None:
            while len(busy) < self._n_workers:
                item = queue.take(busy.values())
                if item is None:
                    return
                worker = idle.pop() if idle else self._added()
                busy[worker] = item
                worker.give(of, item)

        give_out()
        while busy:
            ready = connection.wait([worker.channel for worker in busy], self._pause_s)
            if not ready:
                yield None
            for worker in [w for w in busy if w.channel in ready]:
                result = worker.answer()
                if isinstance(result, str):
                    if result not in self._reported:
                        self._reported.add(result)
                        yield result
                    continue
                item = busy.pop(worker)
                if result is not None and self._fits(worker):
                    idle.append(worker)
                else:
                    self._remove(worker)
                if result is None and self._may_try_again(item):
                    queue.again(item)
                elif result is None:
                    result = of.lost(item, _last_words(worker.process.exitcode))
                in_line = of.line_of(item) is not None
                if in_line and result is not None:
                    yield result  # The next of its line finds it on the disk.
                give_out()
                if not in_line and result is not None:
                    yield result

    def close(self) -> None:
        """End all workers, also in the middle of an item."""
        for worker in self._workers:
            worker.kill()
        for worker in self._workers:
            worker.process.join()
        self._workers = []

    def _may_try_again(self, item: Item) -> bool:
        self._tries[item] = self._tries.get(item, 0) + 1
        return self._tries[item] < TRIES

    def _fits(self, worker: _Worker[Item, Result]) -> bool:
        pid = worker.process.pid
        if pid is None:
            return True
        self._peak_bytes = max(self._peak_bytes, peak_bytes(pid) or 0)
        fits = (resident_bytes(pid) or 0) <= self._limit_bytes
        self._n_renewed += not fits
        return fits

    def _remove(self, worker: _Worker[Item, Result]) -> None:
        worker.kill()
        worker.process.join()
        self._workers.remove(worker)

    def _added(self) -> _Worker[Item, Result]:
        self._workers.append(self._started())
        self._most_workers = max(self._most_workers, len(self._workers))
        return self._workers[-1]

    def _started(self) -> _Worker[Item, Result]:
        # spawn: an OpenGL context does not survive a fork.
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=work, args=(theirs,), daemon=True)
        with interrupts_ignored():
            process.start()
        theirs.close()
        started = _Worker[Item, Result](process, ours)
        started.give(self._work, None)
        return started


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
