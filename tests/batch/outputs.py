"""What a batch has written, and stopping one in the middle."""

from __future__ import annotations

import csv
import subprocess
from pathlib import Path
from time import monotonic, sleep

import psutil

from verefine_viz.batch.rows import TIME_COLUMNS


def without_times(out: Path) -> tuple[list[list[str]], list[dict[str, str]]]:
    """results.csv and frames.csv, the columns of times left out."""
    with (out / "results.csv").open(newline="") as file:
        results = [row[:-1] for row in csv.reader(file)]
    with (out / "frames.csv").open(newline="") as file:
        frames = [{k: v for k, v in row.items() if k not in TIME_COLUMNS} for row in csv.DictReader(file)]
    return results, frames


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
