"""``verefine-viz replay``: a recording in the rerun viewer, or checked against a new run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Replay:
    """Open a recording in the rerun viewer, or run its session again and compare (--verify)."""

    recording: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN.rrd")]
    """A recording that view or batch wrote."""
    verify: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Run the recorded session again and report the first iteration that differs, if any."""

    def run(self, arguments: Sequence[str]) -> int:
        raise NotImplementedError
