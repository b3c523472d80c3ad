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
        return _verify(self.recording) if self.verify else _open(self.recording)


def _verify(recording: Path) -> int:
    from verefine_viz.recording.reader import read_recording
    from verefine_viz.recording.replay import verify

    n = len(read_recording(recording).rows)
    difference = verify(recording)
    if difference:
        print(f"{recording} differs: {difference}")
        return 1
    print(f"{recording}: no difference in {n} iterations")
    return 0


def _open(recording: Path) -> int:
    from verefine_viz.recording.replay import open_viewer

    viewer = open_viewer(recording)
    try:
        return viewer.wait()
    except KeyboardInterrupt:
        return 0
    finally:
        viewer.terminate()
        viewer.wait()
