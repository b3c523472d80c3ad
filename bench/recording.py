"""What recording costs: a RIR frame with and without it, and the bytes it writes."""

from __future__ import annotations

import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Iteration
from verefine_viz.recording.recorder import Recorder
from verefine_viz.session.files import resolve
from verefine_viz.session.toolbox import Toolbox

REPEATS = 12


class Timed:
    """A watcher that measures another."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self.start_ms = self.iterations_ms = self.finish_ms = 0.0

    def on_start(self, state: Any) -> None:
        began = perf_counter()
        self._recorder.on_start(state)
        self.start_ms = (perf_counter() - began) * 1e3

    def on_iteration(self, state: Any, iteration: Iteration) -> None:
        began = perf_counter()
        self._recorder.on_iteration(state, iteration)
        self.iterations_ms += (perf_counter() - began) * 1e3

    def on_finish(self, state: Any) -> None:
        began = perf_counter()
        self._recorder.draw_now()
        self.iterations_ms += (perf_counter() - began) * 1e3
        began = perf_counter()
        self._recorder.on_finish(state)
        self.finish_ms = (perf_counter() - began) * 1e3


def run() -> list[dict[str, object]]:
    """One row without recording, one without maps, one with them; medians, measured in turns."""
    toolboxes = {
        "without recording": None,
        "recording, no maps": _toolbox(maps=False),
        "recording with maps": _toolbox(maps=True),
    }
    plain = _toolbox(maps=False)
    problem = plain.problem(plain.frames[0])
    plain.run(problem).finish()  # compiles kernels, builds colliders and search structures
    n_iterations = plain.run(problem).n_iterations
    found: dict[str, list[tuple[float, float, float, float, int]]] = {name: [] for name in toolboxes}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(REPEATS):
            for name, toolbox in toolboxes.items():
                found[name].append(_measured(plain, problem, toolbox, Path(folder) / "run.rrd"))
    rows: list[dict[str, object]] = []
    off_ms = float(np.median([f[0] for f in found["without recording"]]))
    for name, values in found.items():
        frame, start, iterations, finish, size = np.median(np.array(values), axis=0)
        rows.append(
            {
                "what": f"rir frame, {n_iterations} iterations, {name}",
                "ms": float(frame),
                "ms to open and close": float(start + finish),
                "ms per iteration": float(iterations / n_iterations),
                "% of the iterations": float(100 * iterations / off_ms),
                "kB": float(size / 1e3),
            }
        )
    return rows


def _toolbox(maps: bool) -> Toolbox:
    return Toolbox(resolve({"method": {"name": "rir"}, "scene": {"demo": "mug"}, "recording": {"maps": maps}}))


def _measured(
    plain: Toolbox, problem: Problem, toolbox: Toolbox | None, path: Path
) -> tuple[float, float, float, float, int]:
    """Milliseconds of a frame and of the three parts of its recording, and bytes."""
    watchers = []
    if toolbox is not None:
        watchers = [Timed(Recorder(path, toolbox.session, problem, plain.verifier))]
    began = perf_counter()
    plain.run(problem, watchers).finish()
    frame_ms = (perf_counter() - began) * 1e3
    if not watchers:
        return frame_ms, 0.0, 0.0, 0.0, 0
    w = watchers[0]
    return frame_ms, w.start_ms, w.iterations_ms, w.finish_ms, path.stat().st_size
