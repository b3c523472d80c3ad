"""What a batch has noted, and stopping one in the middle."""

from __future__ import annotations

import subprocess
from pathlib import Path
from time import monotonic, sleep

import psutil


def journal(out: Path) -> list[str]:
    """The files of finished frames."""
    return sorted(p.name for p in (out / "frames").glob("*.json"))


def stop_in_the_middle(child: subprocess.Popen[str], out: Path, n_frames: int) -> int:
    """Stops the batch (SIGSTOP) as soon as a frame is done; how many are. Only the stopped process notes frames."""
    process, deadline = psutil.Process(child.pid), monotonic() + 120
    while not journal(out):
        assert child.poll() is None, f"the batch ended by itself: {child.communicate()}"
        assert monotonic() < deadline
        sleep(0.005)
    process.suspend()
    while process.status() != psutil.STATUS_STOPPED:
        assert monotonic() < deadline
    n_done = len(journal(out))
    assert n_done < n_frames
    return n_done
