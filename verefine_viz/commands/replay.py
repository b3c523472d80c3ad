"""``verefine-viz replay``: a recording in the rerun viewer, or checked against a new run."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.core.errors import InputError, UnavailableError, VerefineError, one_line
from verefine_viz.core.text_format import say

DIFFERS, CANNOT, ENDED_EARLY = 1, 2, 3
"""Exit codes of --verify; the last is for a recording that is the same as far as it goes, but was stopped early."""


@dataclass(frozen=True)
class ReplayCommand:
    """Show a recorded run in the rerun viewer, or run the sessions of any number again and compare (--verify)."""

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN [RUN ...]")]
    """What view or batch wrote (.rrd, .vfrun): one to show, any number with --verify."""
    verify: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Run the recorded session again and report the first iteration that differs, if any (exit code 1; 3: it does not
    differ, but was stopped before its end). One that cannot be compared is reported, and the others go on (2)."""

    def run(self, arguments: Sequence[str]) -> int:
        if not self.recordings:
            raise InputError("missing from verefine-viz replay: RUN; see verefine-viz replay --help")
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
    """Raises InputError where it is a folder; that of a batch is answered with where its recordings are."""
    if recording.is_dir():
        from verefine_viz.batch.index import batch_of, named_runs

        runs = named_runs(batch_of(recording), "runs")
        hint = f"; those of a batch lie in {runs}, and drawn in recordings/ beside it" if runs else ""
        raise InputError(f"{recording} is a folder, expected a recorded run (.rrd, .vfrun){hint}")


def _verify_all(recordings: Sequence[Path]) -> int:
    """The exit code of the worst."""
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
    """0: the same; 1: it differs; 3: the same as far as it goes, but its end is missing."""
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


def _open(recording: Path) -> int:
    from verefine_viz.recording.rerun_viewer import open_viewer

    viewer = open_viewer(recording)
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
