"""What recording costs: frames with and without it, in turns.

The run alone, and with reading the frame, which is what a batch takes per frame: the built-in scenes as BOP folders.
The clock stops when the file is complete. The share is that of pairs of frames measured right after one another;
processor time is that of all threads of the process.

    python -m bench.recording DATASET_FOLDER

measures the same on a BOP data set: every object by itself without reading, and every frame with reading; ground truth
disturbed by 30° and 30 mm, 5 hypotheses.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from rich.console import Console

from bench.__main__ import table
from tests.scenes.write_bop import write_bop
from verefine_viz.core.problem import Problem
from verefine_viz.recording.recorder import Recorder
from verefine_viz.run.record import RunEnd
from verefine_viz.run.run_file import SUFFIX, RunFile
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

REPEATS = 120
"""Runs of the shortest frames: times vary by half from one to the next, and the share must not."""
MUG: dict[str, Any] = {"method": {"name": "rir", "refiner": "icp"}, "scene": {"demo": "mug"}}
CLUTTER: dict[str, Any] = {"method": {"name": "rir", "refiner": "icp", "iterations": 3}, "scene": {"demo": "clutter"}}


def run() -> list[dict[str, object]]:
    """A row per case, without maps and (one object) with them."""
    mug, clutter = _toolbox(MUG, maps=False), _toolbox(CLUTTER, maps=False)
    first, problems = [mug.problem(mug.frames[0])], [clutter.problem(frame) for frame in clutter.frames]
    with tempfile.TemporaryDirectory() as folder:
        read_mug = _written(MUG, first, Path(folder) / "mug")
        read_clutter = _written(CLUTTER, problems, Path(folder) / "clutter")
        return [
            _row("one object", mug, first, REPEATS),
            _row("one object, read from a data set", read_mug, read_mug.frames, REPEATS // 3),
            _row("whole scene", clutter, problems[:1], REPEATS // 8),
            _row("whole scenes, read from a data set", read_clutter, read_clutter.frames, REPEATS // 20),
            _row("one object, maps", _toolbox(MUG, maps=True), first, REPEATS // 10),
        ]


def _written(session: dict[str, Any], problems: Sequence[Problem], folder: Path) -> Toolbox:
    scene = {"source": "bop", "dataset": str(write_bop(folder, problems))}
    return _toolbox({**session, "scene": scene}, maps=False)


def _toolbox(session: dict[str, Any], maps: bool) -> Toolbox:
    return Toolbox(resolve({**session, "recording": {"maps": maps}}))


def _row(what: str, toolbox: Toolbox, frames: Sequence[Problem] | Sequence[str], repeats: int) -> dict[str, object]:
    """Measured in pairs, after each frame was run once: kernels, colliders, search structures, meshes are made."""
    pairs: list[tuple[tuple[float, float], tuple[float, float]]] = []
    size = 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.rrd"
        for frame in frames:
            _measured(toolbox, frame, path)
        for k in range(repeats):
            for frame in frames:
                # As in a batch: a file of that name would have to be replaced.
                size = path.stat().st_size
                path.unlink()
                # In turns: the first of a pair would otherwise always meet the colder caches.
                order = (None, path) if k % 2 else (path, None)
                found = {file: _measured(toolbox, frame, file) for file in order}
                pairs.append((found[None], found[path]))
    off, on = np.array(pairs)[:, 0] * 1e3, np.array(pairs)[:, 1] * 1e3
    best_off, best_on = (some[:, 0].reshape(repeats, -1).min(axis=0) for some in (off, on))
    return {
        "what": f"rir, {what}",
        "ms without": float(np.median(off[:, 0])),
        "ms with": float(np.median(on[:, 0])),
        "% (median of pairs)": float(100 * np.median(on[:, 0] / off[:, 0] - 1)),
        "% (best of each frame)": float(100 * np.median(best_on / best_off - 1)),
        "% processor time": float(100 * np.median(on[:, 1] / off[:, 1] - 1)),
        "kB": float(size / 1e3),
    }


def _measured(toolbox: Toolbox, frame: Problem | str, path: Path | None) -> tuple[float, float]:
    """Wall and processor time [s] of a frame, which is read first if only its name is given; recorded to ``path``."""
    wall, processor = perf_counter(), process_time()
    problem = toolbox.problem(frame) if isinstance(frame, str) else frame
    if path is None:
        toolbox.run(problem).finish()
    else:
        recorder = Recorder(path, toolbox.session, problem, toolbox.verifier_of)
        file = RunFile(path.with_suffix(SUFFIX), toolbox.session)
        toolbox.run(problem, [file, recorder]).finish()
        file.finish(RunEnd(answers=()))
        recorder.close(file.path.read_bytes())
    return perf_counter() - wall, process_time() - processor


def main() -> None:
    """Prints what recording costs on a data set."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--repeats", type=int, default=10)
    arguments = parser.parse_args()
    hypotheses = {"source": "perturb", "rotation_deg": 30, "translation_mm": 30, "max_per_object": 5}
    scene = {"source": "bop", "dataset": str(arguments.dataset.resolve())}
    toolbox = _toolbox(
        {"method": {"name": "rir", "refiner": "icp"}, "scene": scene, "hypotheses": hypotheses}, maps=False
    )
    frames = [toolbox.problem(frame) for frame in toolbox.frames]
    alone = [problem.only([i.instance_id]) for problem in frames for i in problem.instances]
    started = perf_counter()
    rows = [
        _row(f"{len(alone)} objects, one by one", toolbox, alone, arguments.repeats),
        _row(f"{len(frames)} frames, read as a batch does", toolbox, toolbox.frames, arguments.repeats),
    ]
    Console().print(table("recording", rows, perf_counter() - started))


if __name__ == "__main__":
    main()
