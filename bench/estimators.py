"""How often the estimators' initial poses are right on real frames, and what they cost.

    python -m bench.estimators DATASET_FOLDER [--names ppf,pcs] [--least-visible 0.5] [--failures]

DATASET_FOLDER is a BOP data set with ground truth and masks. A hypothesis hits if its ADD-S is below 10 % of the
diameter; the column "right way round" asks the same of ADD(-S), which no depth image can tell for a plain box or can.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from rich.console import Console
from rich.table import Table

from verefine_viz.core.accuracy import CORRECT, PoseErrors
from verefine_viz.core.problem import Target
from verefine_viz.core.protocols import Estimator
from verefine_viz.core.settings import Session
from verefine_viz.estimators.registry import make_estimator
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

WANTED = 5
"""Hypotheses asked for."""


@dataclass(frozen=True)
class Found:
    """What an estimator said about one instance."""

    frame: str
    target: Target
    errors: tuple[PoseErrors, ...]
    wall_ms: float
    cpu_ms: float

    @property
    def relative(self) -> list[float]:
        """ADD-S of each hypothesis as a share of the diameter; a miss where there is none."""
        diameter_mm = 1e3 * self.target.model.diameter_m
        return [e.adds_mm / diameter_mm for e in self.errors] or [np.inf]

    @property
    def right_way_round(self) -> bool:
        return any(e.is_correct for e in self.errors)


def targets_of(dataset: Path, least_visible: float) -> list[tuple[str, Target]]:
    """Every instance with ground truth of which enough is visible, with its frame's name."""
    scene = {"source": "bop", "dataset": str(dataset.resolve())}
    toolbox = Toolbox(resolve({"scene": scene, "hypotheses": {"source": "perturb", "max_per_object": 1}}))
    return [
        (frame, target)
        for frame in toolbox.frames
        for target in toolbox.problem(frame).targets
        if target.instance.T_cam_obj_gt is not None and (target.instance.visib_fract or 0.0) >= least_visible
    ]


def trained(name: str, targets: list[tuple[str, Target]]) -> tuple[Estimator, float]:
    """An estimator that knows every model, and how long a model took it [ms]: the first call less a second one."""
    first = {target.model.obj_id: target for _, target in targets}
    make_estimator(name, Session()).hypotheses(targets[0][1], WANTED)  # compiled before anything is measured
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder  # nothing kept from earlier runs
        estimator = make_estimator(name, Session())
        spent = []
        for target in first.values():
            began = process_time()
            estimator.hypotheses(target, WANTED)
            middle = process_time()
            estimator.hypotheses(target, WANTED)
            spent.append(2e3 * middle - 1e3 * (began + process_time()))
    return estimator, max(0.0, float(np.mean(spent)))


def found(estimator: Estimator, frame: str, target: Target) -> Found:
    """The errors of what the estimator finds for one instance, and what it took."""
    wall, cpu = perf_counter(), process_time()
    hypotheses = estimator.hypotheses(target, WANTED)
    wall, cpu = perf_counter() - wall, process_time() - cpu
    T_gt = target.instance.T_cam_obj_gt
    assert T_gt is not None
    errors = tuple(pose_errors(target.model, h.T_cam_obj, T_gt) for h in hypotheses)
    return Found(frame, target, errors, 1e3 * wall, 1e3 * cpu)


def cells(name: str, all_found: list[Found], train_ms: float) -> list[str]:
    """The row of one estimator."""
    top1 = np.mean([f.relative[0] < CORRECT for f in all_found])
    top5 = np.mean([min(f.relative) < CORRECT for f in all_found])
    best_mm = [min((e.adds_mm for e in f.errors), default=np.inf) for f in all_found]
    cpu = [f.cpu_ms for f in all_found]
    return [
        name,
        str(len(all_found)),
        f"{100 * top1:.0f}",
        f"{100 * top5:.0f}",
        f"{100 * np.mean([f.right_way_round for f in all_found]):.0f}",
        f"{np.median(best_mm):.1f}",
        f"{np.mean([f.wall_ms for f in all_found]):.0f}",
        f"{np.mean(cpu):.0f}",
        f"{np.max(cpu):.0f}",
        f"{train_ms:.0f}",
    ]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--names", default="ppf,pcs")
    parser.add_argument("--least-visible", type=float, default=0.5)
    parser.add_argument("--failures", action="store_true", help="list the instances without a hit")
    arguments = parser.parse_args()
    targets = targets_of(arguments.dataset, arguments.least_visible)
    table = Table(
        title=f"Initial poses, best {WANTED} of each instance ≥ {100 * arguments.least_visible:.0f} % visible"
    )
    table.add_column("")
    for heading in (
        "n",
        "top 1 %",
        f"top {WANTED} %",
        "right way round %",
        "median best ADD-S mm",
        "ms/object",
        "CPU ms",
        "worst CPU ms",
        "train ms/model",
    ):
        table.add_column(heading, justify="right")
    missed: list[str] = []
    for name in arguments.names.split(","):
        estimator, train_ms = trained(name, targets)
        all_found = [found(estimator, frame, target) for frame, target in targets]
        table.add_row(*cells(name, all_found, train_ms))
        missed += [
            f"{name}: frame {f.frame}, {f.target.model.name}: {len(f.errors)} hypotheses, best ADD-S "
            f"{100 * min(f.relative):.0f} % of the diameter"
            for f in all_found
            if min(f.relative) >= CORRECT
        ]
    console = Console(width=130)
    console.print(table)
    if arguments.failures:
        console.print("\n".join(missed) or "no instance without a hit")


if __name__ == "__main__":
    main()
