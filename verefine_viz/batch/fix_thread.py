"""Tries remedies beside the page, in a thread with workers of its own; its state is replaced as a whole."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace

from verefine_viz.batch.fix_command import FixRequest
from verefine_viz.batch.fix_files import FixTable, write_fix
from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.jobs import BatchJob, check_jobs
from verefine_viz.batch.remedy_trials import check_trials, jobs_of
from verefine_viz.batch.run_batch import Backend, BatchStatus, run_batch
from verefine_viz.batch.worker_pool import Pool
from verefine_viz.core.errors import Cancelled, VerefineError

_LOG = logging.getLogger(__name__)
PAUSE_S = 0.5
"""Most time until a stop takes effect [s]."""


@dataclass(frozen=True)
class FixState:
    """How far remedies are tried."""

    is_running: bool = False
    done: int = 0
    """Frames that are done, of ``total``."""
    total: int = 0
    fault: str = ""
    """Why it ended early; empty where it did not."""
    table: FixTable | None = None


class FixThread:
    """Tries remedies until it is done or stopped; frames that failed before are tried again.

    Args:
        request: what is tried.
        n_workers: processes.
        changed: called after each change of :attr:`latest`, on the thread.
    """

    def __init__(self, request: FixRequest, n_workers: int, changed: Callable[[FixState], None]) -> None:
        self.request, self._n_workers, self._changed = request, n_workers, changed
        self.latest = FixState(is_running=True)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._work, name="verefine-fix", daemon=True)

    def start(self) -> FixThread:
        self._thread.start()
        return self

    def stop(self) -> None:
        """Stop; solved frames stay, and the next start goes on from there. Callable from any thread."""
        self._stopping.set()
        self._thread.join(timeout=20)

    def _set(self, state: FixState) -> None:
        self.latest = state
        self._changed(state)

    def _work(self) -> None:
        fault = ""
        try:
            runs = self.request.runs()
            trials = self.request.trials(runs)
            check_trials(trials, runs)
            self._solve([*jobs_of(trials)])
            table = self.request.table(trials, runs)
            write_fix(table, self.request.target)
            self._set(replace(self.latest, is_running=False, table=table))
            return
        except Cancelled:
            fault = "stopped"
        except VerefineError as error:
            fault = str(error)
        except Exception as error:
            _LOG.exception("remedies could not be tried")
            fault = f"{type(error).__name__}: {error}"
        self._set(replace(self.latest, is_running=False, fault=fault))

    def _solve(self, jobs: Sequence[BatchJob]) -> None:
        self._set(replace(self.latest, total=check_jobs(jobs)))
        before, first = 0, jobs[0]
        work = FrameWork(first.session, first.folder.absolute())
        with closing(Pool(work, self._n_workers, pause_s=PAUSE_S)) as pool:
            for job in jobs:
                pool.switch_to(FrameWork(job.session, job.folder.absolute()))
                report = self._report(before)
                run_batch(job.session, job.folder, Backend(self._n_workers), report, retry_failed=True, workers=pool)
                before += len(job.session.scene.frames)

    def _report(self, before: int) -> Callable[[BatchStatus], None]:
        def report(now: BatchStatus) -> None:
            if self._stopping.is_set():
                raise Cancelled
            done = before + now.counts.frames_done
            if done != self.latest.done:
                self._set(replace(self.latest, done=done))

        return report
