"""``verefine-viz estimate``: first poses of every frame to a BOP results CSV, without a screen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.commands.flags import AnySettings, SessionFlags, given


@dataclass(frozen=True)
class Estimate:
    """Find first poses in all frames of a session with its estimator, and keep them as a BOP results CSV."""

    session: Annotated[Path, tyro.conf.Positional]
    """Session file (.toml); its hypotheses.source must be ppf or pcs, or say --hypotheses.source ppf."""
    out: Path
    """CSV file: up to hypotheses.max-per-object rows for each object, score = the estimator's confidence."""
    settings: AnySettings = field(default_factory=SessionFlags)

    def run(self, arguments: Sequence[str]) -> int:
        from verefine_viz.commands.pools import write_pools

        return write_pools(self.session, self.out, given(self.settings, arguments))
