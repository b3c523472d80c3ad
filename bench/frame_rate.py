"""Frames a second of SIR and RIR on a real frame with one object, by refiner and number of calls.

    python -m bench.frame_rate DATASET_FOLDER [--frame 6/0] [--repeats 60]

The paper (Sec. V-C) has 71 and 21 frames a second on a GPU with DenseFusion's refiner and 2 calls a hypothesis. A frame
is solved from its initial poses to its answer: reading it, and what is made once per model, is not part of it. Beside
other programs only the time of the processor tells something; it counts all threads.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from rich.console import Console
from rich.table import Table

from verefine_viz.core.arrays import Float
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

METHODS, REFINERS, CALLS = ("sir", "rir"), ("icp", "depth_net", "depth_net_icp"), (2, 5)
"""Calls are of each hypothesis, of which SIR has one and RIR five."""


def seconds_of(toolbox: Toolbox, frame: str, repeats: int) -> Float:
    """(repeats, 2) time on the clock and of the processor of each run but the first [s]."""
    problem = toolbox.problem(frame)
    toolbox.run(problem).finish()
    seconds = np.empty((repeats, 2))
    for k in range(repeats):
        began = perf_counter(), process_time()
        toolbox.run(problem).finish()
        seconds[k] = perf_counter() - began[0], process_time() - began[1]
    return seconds


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--frame", default="6/0")
    parser.add_argument("--repeats", type=int, default=60)
    given = parser.parse_args()
    scene = {"source": "bop", "dataset": str(given.dataset.resolve()), "frames": [given.frame]}
    table = Table(
        "method", "refiner", "calls", "frames/s, median", "fastest", "of the processor", title=f"Frame {given.frame}"
    )
    for n_calls in CALLS:
        for name in METHODS:
            for refiner in REFINERS:
                method = {"name": name, "refiner": refiner, "iterations": n_calls}
                alike = {"score": {"colour_weight": 0.0}, "hypotheses": {"flips": False}}
                toolbox = Toolbox(resolve({"scene": scene, "method": method, **alike}))
                seconds = seconds_of(toolbox, given.frame, given.repeats)
                clock, processor = seconds.T
                rates = 1 / np.median(clock), 1 / clock.min(), 1 / np.median(processor)
                table.add_row(name, refiner, str(n_calls * (5 if name == "rir" else 1)), *(f"{r:.0f}" for r in rates))
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
