"""What recording costs: frames with and without it, in turns, each closed and complete on disk before the clock stops.

Three cases: one object, a scene of several, and a batch-like sequence of different frames in one process. The share is
that of pairs of frames measured right after one another; processor time counts all threads of the process, the writer
of the recording too.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np

from verefine_viz.core.problem import Problem
from verefine_viz.recording.recorder import Recorder
from verefine_viz.session.files import resolve
from verefine_viz.session.toolbox import Toolbox

REPEATS = 15
MUG: dict[str, Any] = {"method": {"name": "rir"}, "scene": {"demo": "mug"}}
CLUTTER: dict[str, Any] = {"method": {"name": "rir", "iterations": 3}, "scene": {"demo": "clutter"}}


def run() -> list[dict[str, object]]:
    """A row per case, without maps and (one object) with them."""
    mug, clutter = _toolbox(MUG, maps=False), _toolbox(CLUTTER, maps=False)
    first, scenes = [mug.problem(mug.frames[0])], [clutter.problem(f) for f in clutter.frames]
    return [
        _row("one object", mug, first, REPEATS),
        _row("whole scene", clutter, scenes[:1], max(REPEATS // 3, 1)),
        _row("frames of a batch", clutter, scenes, max(REPEATS // 5, 1)),
        _row("one object, maps", _toolbox(MUG, maps=True), first, max(REPEATS // 3, 1)),
    ]


def _toolbox(session: dict[str, Any], maps: bool) -> Toolbox:
    return Toolbox(resolve({**session, "recording": {"maps": maps}}))


def _row(what: str, toolbox: Toolbox, problems: Sequence[Problem], repeats: int) -> dict[str, object]:
    """Measured in pairs, after each frame was run once: kernels, colliders, search structures, meshes are made."""
    pairs: list[tuple[tuple[float, float], tuple[float, float]]] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.rrd"
        for problem in problems:
            _measured(toolbox, problem, path)
        for k in range(repeats):
            for problem in problems:
                # In turns: the first of a pair would otherwise always meet the colder caches.
                order = (None, path) if k % 2 else (path, None)
                found = {file: _measured(toolbox, problem, file) for file in order}
                pairs.append((found[None], found[path]))
        n_iterations = toolbox.run(problems[-1]).n_iterations
        size = path.stat().st_size
    off, on = np.array(pairs)[:, 0] * 1e3, np.array(pairs)[:, 1] * 1e3
    return {
        "what": f"rir, {what}, {n_iterations} iterations",
        "ms without": float(np.median(off[:, 0])),
        "ms with": float(np.median(on[:, 0])),
        "% (median of pairs)": float(100 * np.median(on[:, 0] / off[:, 0] - 1)),
        "% (best of each)": float(100 * (on[:, 0].min() / off[:, 0].min() - 1)),
        "% processor time": float(100 * np.median(on[:, 1] / off[:, 1] - 1)),
        "kB": float(size / 1e3),
    }


def _measured(toolbox: Toolbox, problem: Problem, path: Path | None) -> tuple[float, float]:
    """Wall and processor time [s] of a frame, with its recording where there is a ``path``."""
    wall, processor = perf_counter(), process_time()
    recorders = [] if path is None else [Recorder(path, toolbox.session, problem, toolbox.verifier)]
    toolbox.run(problem, recorders).finish()
    return perf_counter() - wall, process_time() - processor
