"""``verefine-viz replay``: a recording in the rerun viewer, or checked against a new run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.core.errors import InputError

ENDED_EARLY = 3
"""Exit code of --verify for a recording that is the same as the new run as far as it goes, but was stopped early."""


@dataclass(frozen=True)
class Replay:
    """Open a recording in the rerun viewer, or run its session again and compare (--verify)."""

    recording: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN.rrd")]
    """A recording that view or batch wrote."""
    verify: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Run the recorded session again and report the first iteration that differs, if any (exit code 1; 3: it does not
    differ, but was stopped before its end)."""

    def run(self, arguments: Sequence[str]) -> int:
        if self.recording.is_dir():
            from verefine_viz.batch.index import named_runs

            found = named_runs(self.recording, "recordings")
            hint = f"; those of a batch lie in {found}" if found else ""
            raise InputError(f"{self.recording} is a folder, expected a recording (.rrd){hint}")
        return _verify(self.recording) if self.verify else _open(self.recording)


def _verify(recording: Path) -> int:
    """0: the same; 1: it differs; 3: the same as far as it goes, but its end is missing."""
    from verefine_viz.commands.own_refiner import check_refiners
    from verefine_viz.recording.reader import Recorded
    from verefine_viz.recording.verdict import run_again, verdict
    from verefine_viz.session.engine import Run

    def again(recorded: Recorded) -> Run:
        check_refiners(recorded.session, f"recording {recording}", "verify", f"replay {recording} --verify")
        return run_again(recorded)

    found = verdict(recording, again)
    print(f"{recording}: {found.in_words}")
    if found.ends_early:
        return ENDED_EARLY
    return 1 if found.difference else 0


def _open(recording: Path) -> int:
    from verefine_viz.recording.replay import open_viewer

    viewer = open_viewer(recording)
    try:
        where = f"at {viewer.address}  (Ctrl-C" if viewer.address else "in its window  (closing it, or Ctrl-C,"
        print(f"verefine-viz: {recording} in the rerun viewer, {where} ends it)", flush=True)
        return viewer.process.wait()
    except KeyboardInterrupt:
        return 0
    finally:
        viewer.process.terminate()
        viewer.process.wait()
