"""``verefine-viz fix``: tries the remedies of each cause on the answers of a batch."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.commands.flags import check_memory, check_workers
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.writing import check_file


@dataclass(frozen=True)
class FixCommand:
    """Try the remedies of the causes of wrong answers, and count what they mend and what they break. Stopped or killed,
    the same command goes on where it was.

    Without ground truth, doubtful answers are tried, and counted as fitting better or worse.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN_DIR")]
    """The folder of a batch run, or of several."""
    every: Annotated[bool, tyro.conf.arg(name="all"), tyro.conf.FlagCreatePairsOff] = False
    """Try every remedy on all wrong answers, not only on those of its causes."""
    out: Path | None = None
    """Folder for fix.csv and a batch for each remedy; none = RUN_DIR/fix."""
    seed: int = 0
    """Seed of the sample of right answers: at least as many as a remedy is tried on, where there are so many."""
    retry_failed: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Try frames again that failed with a remedy; without it they stay as they are, and their answers are missing."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Worker processes, no more than 4 per core; the answers are the same for any number."""
    worker_memory_gb: float | None = None
    """A worker that holds more than this after a frame is replaced by a new one; none = 80 % of the machine's memory
    shared by all."""
    take: Annotated[tuple[str, ...], tyro.conf.arg(metavar="REMEDY")] = ()
    """Remedies to write, by their names in the table or by their settings (physics.enabled); several are tried together
    as well, as a row of its own."""
    write: Annotated[Path | None, tyro.conf.arg(metavar="SESSION.toml")] = None
    """Write the session with the remedies of --take, else with the one of the largest net gain; of several runs one
    each, SESSION-RUN.toml."""

    def run(self, arguments: Sequence[str]) -> int:
        check_workers(self.workers)
        check_memory(self.worker_memory_gb)
        if self.seed < 0:
            raise SettingsError(f"--seed is {self.seed}, expected 0 or more")
        if self.write is not None:
            check_file(self.write, "mended.toml", "--write")
        from verefine_viz.batch.fix_command import FixRequest, run_fix
        from verefine_viz.batch.index import batch_of
        from verefine_viz.batch.run_batch import Backend

        limit = None if self.worker_memory_gb is None else int(1e9 * self.worker_memory_gb)
        request = FixRequest(
            folder=batch_of(self.folder), out=self.out, seed=self.seed, every=self.every, together=self.take
        )
        return run_fix(request, Backend(self.workers, limit), self.write, self.retry_failed)
