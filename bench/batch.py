"""A long batch of light frames: ``python -m bench.batch [N_FRAMES]``, 5000 by default; takes minutes.

Measured from outside: the parent's memory while frames come in, milliseconds a frame from the first to the last, and
how much of a worker's time is none of a frame's stages.
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

WORKERS = 2
EVERY_S = 0.5


def run(n_frames: int = 5000) -> list[dict[str, Any]]:
    """One batch; rows for the table."""
    root = Path(tempfile.mkdtemp(prefix="verefine-batch-"))
    session, out = write_light_frames(root, n_frames), root / "out"
    command = [sys.executable, "-m", "verefine_viz.cli", "batch", session, "--out", out, "--workers", WORKERS]
    child = subprocess.Popen([str(word) for word in command])
    memory: list[tuple[int, int]] = []
    while child.poll() is None:
        time.sleep(EVERY_S)
        n_done = sum(1 for _ in (out / "frames").glob("*.json"))
        memory.append((n_done, resident_bytes(child.pid) or 0))
    if child.returncode != 0:
        raise RuntimeError(f"the batch ended with {child.returncode}")
    return [*_memory_rows(memory, n_frames), *_time_rows(out, n_frames)]


def _memory_rows(memory: list[tuple[int, int]], n_frames: int) -> list[dict[str, Any]]:
    """The parent's memory when the first frames came in, and when the last did."""
    rows = []
    for low, high in ((0.05, 0.15), (0.45, 0.55), (0.90, 1.0)):
        held = [b for n, b in memory if low * n_frames <= n < high * n_frames]
        share = f"{low:.0%} to {high:.0%} of the frames"
        rows.append({"what": f"parent's memory at {share} [MB]", "value": round(float(np.median(held)) / 1e6, 1)})
    return rows


def _time_rows(out: Path, n_frames: int) -> list[dict[str, Any]]:
    runs, done = Runs(out / "runs"), []
    for k in range(n_frames):
        record = runs.read(f"0/{k}")
        assert record is not None
        assert record.end is not None
        done.append((runs.path(f"0/{k}").stat().st_mtime, record.end))
    done.sort(key=lambda pair: pair[0])
    tenth = n_frames // 10
    rows = []
    # The first tenth holds the start of the workers, so the second one is what later ones are compared with.
    for name, part in (("second", done[tenth : 2 * tenth]), ("last", done[-tenth:])):
        wall_ms = 1e3 * WORKERS * (part[-1][0] - part[0][0]) / (len(part) - 1)
        stages_ms = float(np.mean([_stages_ms(end) for _, end in part]))
        rows.append({"what": f"{name} tenth: ms a frame and worker", "value": round(wall_ms, 2)})
        rows.append({"what": f"{name} tenth: sum of the stages [ms]", "value": round(stages_ms, 2)})
        rows.append(
            {"what": f"{name} tenth: more than the stages [%]", "value": round(100 * (wall_ms / stages_ms - 1), 1)}
        )
    totals = json.loads((out / "run.json").read_text())
    rows.append({"what": f"whole batch of {n_frames} frames [s]", "value": round(totals["seconds"], 1)})
    rows += [
        {"what": f"stage {name} [ms]", "value": round(ms, 2)}
        for name, ms in totals["totals"]["mean_stages_ms_per_frame"].items()
    ]
    return [*rows, {"what": "memory", "value": totals["memory"]}]


def _stages_ms(end: RunEnd) -> float:
    return sum(end.stages_ms.values())


if __name__ == "__main__":
    for row in run(int(sys.argv[1]) if len(sys.argv) > 1 else 5000):
        print(f"{row['what']:<50} {row['value']}")
