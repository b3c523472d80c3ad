"""A long batch of light frames, and how it scales: ``python -m bench.batch [N_FRAMES]``, 1000 by default.

Measured from outside: the memory of parent and workers while frames come in, milliseconds a frame from the first to the
last, how much of a worker's time is none of a frame's stages; and frames a second of two workers against one, with
processes and on a Dask cluster of this machine.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.light_frames import write_light_frames
from verefine_viz.batch.machine import resident_bytes
from verefine_viz.batch.runs import Runs
from verefine_viz.run.record import RunEnd

EVERY_S = 0.5
Memory = list[tuple[int, int, int]]
"""Frames that are there, bytes of the parent, bytes of the largest worker; twice a second."""


def run(n_frames: int = 1000) -> list[dict[str, Any]]:
    """One long batch and four shorter ones; rows for the table."""
    root = Path(tempfile.mkdtemp(prefix="verefine-batch-"))
    session = write_light_frames(root, n_frames)
    _batch(session, root / "warm", 2, [])
    memory = _batch(session, root / "out", 2, [])
    rows = [*_memory_rows(memory, n_frames), *_time_rows(root / "out", n_frames)]
    for name, options in (("processes", []), ("Dask", ["--cluster", "local"])):
        one, two = (root / f"{name}{n}" for n in (1, 2))
        _batch(session, one, 1, options)
        _batch(session, two, 2, options)
        gain = _frames_a_second(two, n_frames) / _frames_a_second(one, n_frames)
        rows.append({"what": f"{name}: two workers against one", "value": round(gain, 2)})
    return rows


def _batch(session: Path, out: Path, n_workers: int, options: list[str]) -> Memory:
    """Run a batch; how its memory went."""
    words = [sys.executable, "-m", "verefine_viz", "batch", session, "--out", out, "--workers", n_workers, *options]
    child = subprocess.Popen([str(word) for word in words], stdout=subprocess.DEVNULL)
    memory: Memory = []
    while child.poll() is None:
        time.sleep(EVERY_S)
        workers = [resident_bytes(pid) or 0 for pid in _below(child.pid)]
        n_done = sum(1 for _ in (out / "runs").glob("*.vfrun"))
        memory.append((n_done, resident_bytes(child.pid) or 0, max(workers, default=0)))
    if child.returncode != 0:
        raise RuntimeError(f"the batch ended with {child.returncode}")
    return memory


def _below(pid: int) -> list[int]:
    """The processes that a process started, and that those did."""
    try:
        words = [f.read_text() for f in Path(f"/proc/{pid}/task").glob("*/children")]
    except OSError:
        return []
    children = [int(word) for one in words for word in one.split()]
    return [*children, *(deeper for child in children for deeper in _below(child))]


def _memory_rows(memory: Memory, n_frames: int) -> list[dict[str, Any]]:
    """The parent's memory when the first frames came in, and when the last did; the most of a worker."""
    rows = []
    for low, high in ((0.05, 0.25), (0.40, 0.60), (0.75, 1.0)):
        held = [parent for n, parent, _ in memory if low * n_frames <= n < high * n_frames]
        share = f"{low:.0%} to {high:.0%} of the frames"
        rows.append({"what": f"parent's memory at {share} [MB]", "value": round(float(np.median(held)) / 1e6, 1)})
    largest = max(worker for _, _, worker in memory)
    return [*rows, {"what": "a worker's memory, at most [MB]", "value": round(largest / 1e6, 1)}]


def _ends(out: Path, n_frames: int) -> list[tuple[float, RunEnd]]:
    """When each frame was written, and how it ended; in the order of time."""
    runs, done = Runs(out / "runs"), []
    for k in range(n_frames):
        record = runs.read(f"0/{k}")
        assert record is not None
        assert record.end is not None
        done.append((runs.path(f"0/{k}").stat().st_mtime, record.end))
    return sorted(done, key=lambda pair: pair[0])


def _frames_a_second(out: Path, n_frames: int) -> float:
    """Without the first tenth, in which the workers start."""
    done = _ends(out, n_frames)[n_frames // 10 :]
    return (len(done) - 1) / (done[-1][0] - done[0][0])


def _time_rows(out: Path, n_frames: int) -> list[dict[str, Any]]:
    done, tenth = _ends(out, n_frames), n_frames // 10
    rows = []
    # The first tenth holds the start of the workers, so the second one is what later ones are compared with.
    for name, part in (("second", done[tenth : 2 * tenth]), ("last", done[-tenth:])):
        wall_ms = 1e3 * 2 * (part[-1][0] - part[0][0]) / (len(part) - 1)
        stages_ms = float(np.mean([_stages_ms(end) for _, end in part]))
        rows.append({"what": f"{name} tenth: ms a frame and worker", "value": round(wall_ms, 2)})
        rows.append({"what": f"{name} tenth: sum of the stages [ms]", "value": round(stages_ms, 2)})
    totals = json.loads((out / "run.json").read_text())
    rows.append({"what": f"whole batch of {n_frames} frames [s]", "value": round(totals["seconds"], 1)})
    return rows + [
        {"what": f"stage {name} [ms]", "value": round(ms, 2)}
        for name, ms in totals["totals"]["mean_stages_ms_per_frame"].items()
    ]


def _stages_ms(end: RunEnd) -> float:
    return sum(end.stages_ms.values())


if __name__ == "__main__":
    for row in run(int(sys.argv[1]) if len(sys.argv) > 1 else 1000):
        print(f"{row['what']:<50} {row['value']}")
