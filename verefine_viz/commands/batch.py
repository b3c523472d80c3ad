"""``verefine-viz batch``: the same steps over many frames, without a screen."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.commands.flags import AnySettings, SessionFlags, given
from verefine_viz.core.errors import SettingsError


@dataclass(frozen=True)
class Batch:
    """Run sessions over all their frames, headless. Stopped or killed, the same command goes on where it was."""

    sessions: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="SESSION [SESSION ...]")]
    """Session files (.toml); several of them get a folder each below --out."""
    out: Path
    """Folder for results.csv, frames.csv, recordings/, session.toml and run.json."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Worker processes; the results are the same for any number."""
    settings: AnySettings = field(default_factory=SessionFlags)

    def run(self, arguments: Sequence[str]) -> int:
        if not self.sessions:
            raise SettingsError("no session file given; say verefine-viz batch SESSION.toml --out FOLDER")
        if self.workers < 1:
            raise SettingsError(f"--workers is {self.workers}, expected 1 or more")
        from verefine_viz.batch.command import run_sessions

        return run_sessions(self.sessions, self.out, self.workers, given(self.settings, arguments))
