"""Independent jobs that take seconds each, several at a time, with the reports of all in one line."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from queue import SimpleQueue
from typing import TypeVar

from verefine_viz.core.errors import VerefineError
from verefine_viz.core.progress_token import ProgressToken

T = TypeVar("T")

CHECKPOINT_S = 0.1
"""Time between two checkpoints [s]."""


def side_by_side(jobs: Sequence[Callable[[ProgressToken], T]], progress: ProgressToken) -> list[T | VerefineError]:
    """What each of the jobs returns, or the error that it raises, in their order; as many at a time as there are cores.

    Jobs run on threads of their own. They gain where they wait for processes or for libraries that release Python's
    lock, and must depend on their arguments only: the results are then those of one after the other.

    Args:
        jobs: each gets a token to report to.
        progress: hears of all jobs, and is asked, on the calling thread alone.

    Raises:
        Cancelled: through ``progress``; every job has ended then.
    """
    ended, announced = threading.Event(), SimpleQueue[str]()
    doing: dict[int, str] = {}

    def token(k: int) -> ProgressToken:
        def report(words: str, share: float | None) -> None:
            if words:
                doing[k] = words

        return ProgressToken(report, lambda: not ended.is_set(), announced.put)

    def done(k: int, job: Callable[[ProgressToken], T]) -> T | VerefineError:
        try:
            return job(token(k))
        except VerefineError as error:
            return error
        finally:
            doing.pop(k, None)

    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        try:
            futures = [pool.submit(done, k, job) for k, job in enumerate(jobs)]
            left: set[Future[T | VerefineError]] = set(futures)
            shown = ""
            while left:
                left = wait(left, CHECKPOINT_S, FIRST_COMPLETED).not_done
                while not announced.empty():
                    progress.announce(announced.get())
                now = " ".join(words for _, words in sorted(doing.copy().items()))
                progress.checkpoint(now if now != shown else "", 1 - len(left) / len(jobs))
                shown = now
        except BaseException:
            ended.set()
            raise
    return [future.result() for future in futures]
