"""Batches that are stopped or killed and started again, and what they have written.

SIGKILL hits the parent while it starts, between frames, while it writes. Workers must end by themselves.
"""

from __future__ import annotations

import csv
import random
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import psutil

from verefine_viz.batch.runs import Runs
from verefine_viz.run.answers import COLUMNS

TIMES = {column.name for column in COLUMNS if column.kind == "time"}
PATIENCE_S = 600.0


@dataclass(frozen=True)
class Killed:
    """How a batch came to its end."""

    kills: int
    frames_at_kill: tuple[int, ...]
    """How many frames were done when each kill came."""


def done(out: Path) -> list[str]:
    """The frames that are finished."""
    runs = Runs(out / "runs")
    return [record.header.frame for record in runs.records(runs.frames)]


def n_done(out: Path) -> int:
    return len(done(out))


def without_times(out: Path) -> tuple[list[list[str]], list[dict[str, str]]]:
    """results.csv and frames.csv, the columns of times left out."""
    with (out / "results.csv").open(newline="") as file:
        results = [row[:-1] for row in csv.reader(file)]
    with (out / "frames.csv").open(newline="") as file:
        frames = [{k: v for k, v in row.items() if k not in TIMES} for row in csv.DictReader(file)]
    return results, frames


def stop_in_the_middle(child: subprocess.Popen[str], out: Path, n_frames: int) -> int:
    """Stops the batch (SIGSTOP) as soon as a frame is done; how many are. Its workers still finish theirs."""
    process, deadline = psutil.Process(child.pid), time.monotonic() + PATIENCE_S
    while not done(out):
        assert child.poll() is None, f"the batch ended by itself: {child.communicate()}"
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.suspend()
    while process.status() != psutil.STATUS_STOPPED:
        assert time.monotonic() < deadline
    n = n_done(out)
    assert n < n_frames
    return n


def workers_of(child: subprocess.Popen[str]) -> list[psutil.Process]:
    return [p for p in psutil.Process(child.pid).children() if "spawn_main" in " ".join(p.cmdline())]


def killed_until_done(
    command: list[str],
    n_done: Callable[[], int],
    n_kills: int,
    rng: random.Random,
    tell: Callable[[str], None] = lambda _: None,
) -> Killed:
    """Starts ``command``, kills it, and so on; at last lets it run to its end.

    Args:
        command: of a batch or a study.
        n_done: how many of its frames or units are done.
        n_kills: how often.
        rng: of the moments.
        tell: gets a line for each kill.

    Raises:
        RuntimeError: a start hangs or fails, or workers outlive their parent.
    """
    at: list[int] = []
    for _ in range(n_kills):
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        wanted = n_done() + rng.choice((0, 1, 1, 2, 3))
        _wait_for(child, n_done, wanted)
        # A third of them while the next start is still importing, the others between two frames or in the middle.
        time.sleep(rng.uniform(0.0, 2.0 if wanted == n_done() else 0.2))
        workers = psutil.Process(child.pid).children() if child.poll() is None else []
        child.kill()
        if child.wait() != -9:
            break  # It was done before.
        at.append(n_done())
        tell(f"killed with {at[-1]} frames done")
        left = psutil.wait_procs(workers, timeout=PATIENCE_S)[1]
        if left:
            raise RuntimeError(f"{len(left)} workers of a killed batch still run")
    last = subprocess.run(command, capture_output=True, text=True, check=False)
    if last.returncode != 0:
        raise RuntimeError(f"the last start failed: {last.stderr}")
    return Killed(len(at), tuple(at))


def _wait_for(child: subprocess.Popen[bytes], n_done: Callable[[], int], wanted: int) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while child.poll() is None and n_done() < wanted:
        if time.monotonic() > deadline:
            raise RuntimeError(f"no frame was done in {PATIENCE_S:.0f} s")
        time.sleep(0.01)
