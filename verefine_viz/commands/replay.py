"""``verefine-viz replay``: a recording in the rerun viewer, drawn from a run file, or checked against a new run."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.core.errors import InputError, UnavailableError, VerefineError, one_line
from verefine_viz.core.text_format import say

DIFFERS, CANNOT, ENDED_EARLY = 1, 2, 3
"""Exit codes of --verify; the last is for a recording without a difference that was stopped early."""


@dataclass(frozen=True)
class ReplayCommand:
    """Show a recorded run in the rerun viewer, draw recordings of run files (--draw), or run the sessions of any number
    again and compare (--verify).
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN [RUN ...]")]
    """What view or batch wrote (.rrd, .vfrun): one to show, any number with --verify; with --draw run files, or
    folders of batches."""
    verify: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Run the recorded session again and report the first iteration that differs, if any (exit code 1; 3: it does not
    differ, but was stopped before its end). One that cannot be compared is reported, and the others go on (2)."""

    draw: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Draw recordings of run files; of a batch's folder, those that it has not kept. They go into recordings/ of the
    batch, else beside the run file. One that cannot be drawn is named, and the others go on (exit code 1)."""
    out: Path | None = None
    """With --draw: where the recording of a single run goes, for example run.rrd."""
    workers: int = max(os.cpu_count() or 1, 1)
    """With --draw: worker processes."""

    def run(self, arguments: Sequence[str]) -> int:
        if not self.recordings:
            raise InputError("missing from verefine-viz replay: RUN; see verefine-viz replay --help")
        if self.draw:
            return _draw(self.recordings, self.out, self.workers)
        if self.verify:
            return _verify_all(self.recordings)
        recording, *others = self.recordings
        if others:
            raise InputError(
                f"{len(self.recordings)} recordings are more than the viewer's one; --verify compares any number with"
                " new runs, and verefine-viz view A.rrd B.rrd shows two of a frame side by side"
            )
        _check_file(recording)
        return _open(recording)


def _check_file(recording: Path) -> None:
    """Raise InputError where the path is a folder; for a batch folder the error says where its recordings are."""
    if recording.is_dir():
        from verefine_viz.batch.index import batch_of, named_runs

        runs = named_runs(batch_of(recording), "runs")
        hint = f"; those of a batch lie in {runs}, and drawn in recordings/ beside it" if runs else ""
        raise InputError(f"{recording} is a folder, expected a recorded run (.rrd, .vfrun){hint}")


def _draw(paths: Sequence[Path], out: Path | None, n_workers: int) -> int:
    """Draw recordings; exit code 0: all are drawn, 1: some are not."""
    from dataclasses import replace

    from verefine_viz.batch.draw_recordings import draw_recordings, to_draw
    from verefine_viz.commands.flags import check_workers
    from verefine_viz.core.console import ProgressBar

    check_workers(n_workers)
    wanted = [one for path in paths for one in to_draw(path)]
    if out is not None:
        if len(paths) > 1 or paths[0].is_dir():
            raise InputError(
                "--out names the recording of a single run file; recordings of others go beside their runs"
            )
        wanted = [replace(wanted[0], recording=out)]
    with ProgressBar("recordings") as bar:
        faults = [one.fault for one in draw_recordings(wanted, n_workers, bar.show) if one.fault] if wanted else []
    for fault in faults:
        say(f"verefine-viz: {fault}", sys.stderr)
    n, where = len(wanted) - len(faults), sorted({one.recording.parent for one in wanted})
    there = f" in {', '.join(map(str, where))}" if where else ": all are there"
    say(one_line(str(wanted[0].recording)) if n == len(wanted) == 1 else f"{n} recordings drawn{there}")
    return 1 if faults else 0


def _verify_all(recordings: Sequence[Path]) -> int:
    """Verify all recordings; return the exit code of the worst."""
    if len(recordings) == 1:
        return _verify(recordings[0])
    codes = set[int]()
    for recording in recordings:
        try:
            codes.add(_verify(recording))
        except VerefineError as error:
            say(f"verefine-viz: {error}", sys.stderr)
            codes.add(CANNOT)
    return next(code for code in (CANNOT, DIFFERS, ENDED_EARLY, 0) if code in codes)


def _verify(recording: Path) -> int:
    """Verify a recording; exit code 0: no difference, 1: a difference, 3: no difference, but its end is missing."""
    from verefine_viz.batch.solve_frame import end_again
    from verefine_viz.recording.verify import run_again, verify
    from verefine_viz.run.engine import Run
    from verefine_viz.run.record import RunRecord
    from verefine_viz.run.run_header import session_of
    from verefine_viz.run.session_parts import check_parts

    def again(record: RunRecord) -> Run:
        check_parts(session_of(record.header), f"recording {recording}", "verify", f"replay {recording} --verify")
        return run_again(record)

    _check_file(recording)
    verification = verify(recording, again, end_again)
    say(one_line(f"{recording}: {verification.text}"))
    if verification.ends_early:
        return ENDED_EARLY
    return DIFFERS if verification.difference else 0


def _drawn(path: Path) -> Path:
    """A recording as it is; a run file as a temporary recording of it."""
    from verefine_viz.run.run_file import SUFFIX

    if path.suffix != SUFFIX:
        return path
    from verefine_viz.batch.draw_run_file import RunDrawer

    recording = Path(tempfile.mkdtemp(prefix="verefine-")) / path.with_suffix(".rrd").name
    RunDrawer().draw(path, recording)
    return recording


def _open(recording: Path) -> int:
    from verefine_viz.recording.rerun_viewer import open_viewer

    viewer = open_viewer(_drawn(recording))
    try:
        if viewer.note:
            say(f"note: {one_line(viewer.note)}", sys.stderr)
        where = f"at {viewer.address}  (Ctrl-C" if viewer.address else "in its window  (closing it, or Ctrl-C,"
        say(f"verefine-viz: {one_line(str(recording))} in the rerun viewer, {where} ends it)")
        code = viewer.process.wait()
        if code > 0:
            why = "with RUST_LOG=warn in its environment it says why"
            raise UnavailableError(f"the rerun viewer ended by itself with exit code {code}; {why}")
        return 0
    except KeyboardInterrupt:
        return 0
    finally:
        viewer.process.terminate()
        viewer.process.wait()
