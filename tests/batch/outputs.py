"""What a batch has written, and stopping one in the middle."""

from __future__ import annotations

import subprocess
from pathlib import Path
from time import monotonic, sleep

import psutil

from verefine_viz.batch.runs import Runs


def done(out: Path) -> list[str]:
    """The frames that are finished."""
    runs = Runs(out / "runs")
    return [record.header.frame for record in runs.records(runs.frames)]


def stop_in_the_middle(child: subprocess.Popen[str], out: Path, n_frames: int) -> int:
    """Stops the batch (SIGSTOP) as soon as a frame is done; how many are. Its workers still finish theirs."""
    process, deadline = psutil.Process(child.pid), monotonic() + 120
    while not done(out):
        assert child.poll() is None, f"the batch ended by itself: {child.communicate()}"
        assert monotonic() < deadline
        sleep(0.005)
    process.suspend()
    while process.status() != psutil.STATUS_STOPPED:
        assert monotonic() < deadline
    n_done = len(done(out))
    assert n_done < n_frames
    return n_done
