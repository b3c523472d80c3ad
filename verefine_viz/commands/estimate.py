"""``verefine-viz estimate``: initial poses of every frame to a BOP results CSV, without a screen."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.commands.flags import AnySettings, SessionFlags, check_workers, given


@dataclass(frozen=True)
class EstimateCommand:
    """Find initial poses in all frames with the session's estimator: a BOP results CSV. Stopped, it can go on later."""

    session: Annotated[Path, tyro.conf.Positional]
    """Session file (.toml), or a folder of data that view opens; its hypotheses.source must be ppf, pcs or
    densefusion, or use --hypotheses.source ppf."""
    out: Path
    """CSV file: up to hypotheses.max-per-object rows for each object, score = the estimator's confidence."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Worker processes, no more than 4 per core, of which no more are started than there are frames; the results are
    the same for any number."""
    retry_failed: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Try frames again that failed in an earlier start of the same command, or in which a model or mask could not be
    read."""
    settings: AnySettings = field(default_factory=SessionFlags)

    def run(self, arguments: Sequence[str]) -> int:
        from verefine_viz.commands.estimate_frames import write_pools

        check_workers(self.workers)
        return write_pools(self.session, self.out, given(self.settings, arguments), self.workers, self.retry_failed)
