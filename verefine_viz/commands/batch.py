"""``verefine-viz batch``: the same steps over many frames, without a screen."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.commands.flags import AnySettings, SessionFlags, check_memory, check_seeds, check_workers, given
from verefine_viz.core.errors import SettingsError


@dataclass(frozen=True)
class BatchCommand:
    """Run sessions over all their frames, headless. Stopped or killed, the same command goes on where it was."""

    sessions: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="SESSION [SESSION ...]")]
    """Session files (.toml), or folders of data that view opens; several of them get a folder each below --out."""
    out: Path
    """Folder for results.csv, frames.csv, runs/, recordings/, session.toml and run.json."""
    methods: tuple[str, ...] = ()
    """Run every session with each of these methods (pir sir rir …), each in a folder METHOD-SEED below --out; none =
    the session's own."""
    seeds: int | None = None
    """Run everything with seeds 0 … N-1, of the initial poses and of the method (hypotheses.seed, method.seed); none =
    the session's own, at most 1000. verefine-viz report OUT then compares the methods, with their spread over the
    seeds."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Worker processes of this machine, no more than 4 per core, of which no more are started than there are frames;
    the results are the same for any number. A cluster that is running has its own."""
    worker_memory_gb: float | None = None
    """A worker that holds more than this after a frame is replaced by a new one; none = 80 % of the machine's memory
    shared by all."""
    retry_failed: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Try frames again that failed before, in which a model or mask could not be read, or whose recording is gone;
    without it they stay as they are."""
    diagnose: bool = True
    """Diagnose wrong answers where ground truth is known (columns cause and evidence); its re-runs take time, for
    wrong answers only."""
    grasp: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Carry out a grasp at each answer and at its ground truth, in simulation (columns grasp and grasp_ground_truth);
    takes seconds per object. The same as --grasp.answers True."""
    cluster: str = ""
    """Address of a Dask scheduler (tcp://host:8786), or "local" to start one here: frames are solved by its workers,
    which read the data set and write recordings by path, from storage that all machines share."""
    settings: AnySettings = field(default_factory=SessionFlags)

    def run(self, arguments: Sequence[str]) -> int:
        if self.cluster in ("", "local"):
            check_workers(self.workers)
        check_memory(self.worker_memory_gb)
        check_seeds(self.seeds)
        from verefine_viz.batch.batch_command import run_jobs
        from verefine_viz.batch.jobs import session_jobs, sweep_jobs
        from verefine_viz.batch.run_batch import Backend

        limit = None if self.worker_memory_gb is None else int(1e9 * self.worker_memory_gb)
        backend = Backend(self.workers, limit, self.cluster)
        task = "explain" if self.diagnose else "solve"
        overrides = given(self.settings, arguments)
        if not self.sessions and "scene" not in overrides:
            raise SettingsError("no session given; use verefine-viz batch SESSION --out FOLDER, or --scene.demo mug")
        if self.grasp:
            overrides["grasp"] = {**overrides.get("grasp", {}), "answers": True}
        sessions: tuple[Path | None, ...] = self.sessions or (None,)
        if self.methods or self.seeds is not None:
            jobs = sweep_jobs(sessions, self.out, overrides, self.methods, self.seeds)
        else:
            jobs = session_jobs(sessions, self.out, overrides)
        return run_jobs(jobs, self.out, backend, self.retry_failed, task)
