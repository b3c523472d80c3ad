"""Refiners against each other at equal numbers of calls: the learned ones and ICP, on real frames or built-in scenes.

    python -m bench.learned [DATASET_FOLDER] [--refiners icp densefusion] [--seeds 2] [--calls 1 5]
                            [--iterations 4] [--weights F.onnx]

Every instance of the BOP data set, or without one of the built-in scenes, starts from its ground truth, disturbed by a
turn and a shift; each refiner is called so many times on its own results. ``--iterations`` and ``--weights`` are
depth_net's. Times are of the processor.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
from rich.console import Console
from rich.table import Table

from verefine_viz.core.accuracy import PoseErrors
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.refiners.registry import make_refiner
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

SCENES = ("mug", "duck", "bowl", "bracket", "stack", "clutter")
"""Built-in scenes."""
STARTS = ((10, 10), (20, 20), (30, 30), (45, 40), (60, 40))
"""Turn [deg] and shift [mm]."""
REFINERS = ("icp", "depth_net", "depth_net_icp")
AUC_MM = 20.0
"""Error beyond which a pose counts 0 in the area under the curve [mm]."""


@dataclass(frozen=True)
class Row:
    """One refiner from one kind of start."""

    start: str
    name: str
    errors: tuple[PoseErrors, ...]
    ms_per_call: float

    def cells(self) -> list[str]:
        add = np.array([e.add_s_mm for e in self.errors])
        auc = 100 * np.clip(1 - add / AUC_MM, 0, None).mean()
        right = 100 * np.mean([e.is_correct for e in self.errors])
        ms = f"{self.ms_per_call:.2f}" if self.ms_per_call else ""
        return [self.start, self.name, str(len(add)), f"{np.median(add):.1f}", f"{auc:.0f}", f"{right:.0f}", ms]


def starts(scenes: list[dict[str, str]], turn_deg: float, shift_mm: float, seeds: int) -> list[tuple[Target, Float]]:
    """Every instance with each of its disturbed poses."""
    hypotheses = {"rotation_deg": turn_deg, "translation_mm": shift_mm, "max_per_object": seeds}
    toolboxes = [
        Toolbox(resolve({"scene": scene, "hypotheses": {"source": "perturb", **hypotheses}})) for scene in scenes
    ]
    return [
        (target, h.T_cam_obj)
        for toolbox in toolboxes
        for frame in toolbox.frames
        for target in toolbox.source.problem(frame).targets
        for h in target.instance.hypotheses
    ]


def refined(name: str, refiner: Refiner, cases: list[tuple[Target, Float]], n_calls: int, start: str) -> Row:
    """Errors after ``n_calls`` calls each."""
    errors: list[PoseErrors] = []
    seconds = 0.0
    for target, T in cases:
        refiner.refine(target, T)  # What is made once per target is not timed.
        began = process_time()
        for _ in range(n_calls):
            T = refiner.refine(target, T)
        seconds += process_time() - began
        errors.append(error_of(target, T))
    return Row(start, f"{name}, {n_calls} ×", tuple(errors), 1e3 * seconds / max(len(cases) * n_calls, 1))


def error_of(target: Target, T_cam_obj: Float) -> PoseErrors:
    """Against the ground truth, which the instance has."""
    assert target.instance.T_cam_obj_gt is not None
    return pose_errors(target.model, T_cam_obj, target.instance.T_cam_obj_gt)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, nargs="?")
    parser.add_argument("--refiners", nargs="+", default=REFINERS)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--calls", type=int, nargs="+", default=[1, 5])
    parser.add_argument("--iterations", type=int, default=None, help="steps of the network per call")
    parser.add_argument("--weights", type=Path, default=None)
    arguments = parser.parse_args()
    net = {"weights": str(arguments.weights.resolve())} if arguments.weights else {}
    net |= {"iterations": arguments.iterations} if arguments.iterations else {}
    dataset = arguments.dataset
    scenes = [{"source": "bop", "dataset": str(dataset.resolve())}] if dataset else [{"demo": name} for name in SCENES]
    session = resolve({"scene": scenes[0], "depth_net": net})
    table = Table(title=f"Refiners on {'real frames' if dataset else 'built-in scenes'}")
    for heading in ("start", "refiner, calls", "n", "median ADD(-S) mm", "AUC, %", "< 10 % d, %", "ms/call"):
        table.add_column(heading, justify="left" if heading in ("start", "refiner, calls") else "right")
    for turn_deg, shift_mm in STARTS:
        start = f"{turn_deg}°, {shift_mm} mm"
        cases = starts(scenes, turn_deg, shift_mm, arguments.seeds)
        table.add_row(*Row(start, "initial pose", tuple(error_of(t, T) for t, T in cases), 0.0).cells())
        for n_calls in arguments.calls:
            for name in arguments.refiners:
                table.add_row(*refined(name, make_refiner(name, session), cases, n_calls, start).cells())
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
