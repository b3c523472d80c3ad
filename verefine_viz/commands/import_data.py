"""``verefine-viz import``: what another program recorded, as a data set in BOP layout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.core.text_format import say


@dataclass(frozen=True)
class ImportCommand:
    """Write traces, or frames in another layout that view knows, as a data set in BOP layout with a session."""

    folder: Annotated[Path, tyro.conf.Positional]
    """A trace, a folder of traces, or frames of FoundationPose, Extended APC, …; what view says it is."""
    out: Path
    """New folder for the data set; frames are added to one that Frame.keep or this command made."""

    def run(self, arguments: Sequence[str]) -> int:
        from verefine_viz.run.imported_folder import imported

        n_failed = n_done = 0
        for line in imported(self.folder, self.out):
            n_failed += " failed: " in line
            n_done += " → " in line
            say(line)
        say(f"View it: verefine-viz view {self.out}" if n_done else "No frame was imported.")
        return 1 if n_failed else 0
