"""Accuracy on whole scenes: every method on the same frames with the same budget of refiner calls.

    python -m bench.whole_scenes [--dataset FOLDER] [--seeds 1] [--preset recommended] [--refiner icp] [--methods …]

prints a table for the built-in scenes clutter and stack and, with the folder of a BOP data set, for all of its frames
(ground truth disturbed by 30° and 30 mm, 5 hypotheses) and for its key frames with ``pose_estimates/*.csv`` as pools.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from verefine_viz.core.accuracy import PoseErrors
from verefine_viz.core.arrays import Float
from verefine_viz.core.presets import PRESETS
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.methods.known_methods import method_of
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

METHODS = ("refine", "pir", "sir", "rir", "vf_breadth", "vf_depth", "physim_mcts")
SINGLE = ("refine", "pir", "sir")
"""Methods that use one hypothesis: they get the whole budget of H·K refiner calls."""
ITERATIONS = 5
ESTIMATORS = ("cosypose_ycbv-test", "posecnn-rss2018_ycbv-test", "sundermeyer_ycbv-test")


@dataclass
class Counted:
    """A refiner that counts its calls."""

    inner: Refiner
    calls: int = 0

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """What the refiner inside answers."""
        self.calls += 1
        return self.inner.refine(target, T_cam_obj, fixed)


@dataclass
class Row:
    """One method on many frames."""

    name: str
    errors: list[PoseErrors] = field(default_factory=list)
    n_frames: int = 0
    seconds: float = 0.0
    calls: int = 0

    def cells(self) -> list[str]:
        """As the columns of :func:`show`."""
        add = np.array([e.add_s_mm for e in self.errors])
        frames = max(self.n_frames, 1)
        return [
            self.name,
            str(len(add)),
            f"{np.median(add):.1f}",
            f"{add.mean():.1f}",
            f"{np.median([e.rotation_deg for e in self.errors]):.1f}",
            f"{np.mean([e.rotation_deg for e in self.errors]):.1f}",
            f"{np.median([e.translation_mm for e in self.errors]):.1f}",
            f"{np.mean([e.translation_mm for e in self.errors]):.1f}",
            f"{100 * np.mean([e.is_correct for e in self.errors]):.0f}",
            f"{1e3 * self.seconds / frames:.0f}",
            f"{self.calls / frames:.0f}",
        ]


def show(title: str, rows: Sequence[Row]) -> None:
    """One table on the terminal."""
    table = Table(title=title)
    table.add_column("")
    for heading in ("n", "ADD(-S) mm", "mean", "rot °", "mean", "trans mm", "mean", "< 10 % d, %", "ms/frame", "calls"):
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(*row.cells())
    Console(width=130).print(table)


def frames_of(raw: dict[str, Any], seeds: int) -> Iterator[tuple[dict[str, Any], str]]:
    """Every frame of the session ``raw``, once per seed of its disturbance."""
    for seed in range(seeds):
        seeded = {**raw, "hypotheses": {**raw["hypotheses"], "seed": seed}}
        for frame in Toolbox(resolve(seeded)).frames:
            yield seeded, frame


def initial_poses(raw: dict[str, Any], seeds: int) -> Row:
    """The best-trusted hypothesis of each object, as it is."""
    row = Row("first hypothesis")
    for seeded, frame in frames_of(raw, seeds):
        problem = Toolbox(resolve(seeded)).problem(frame)
        row.n_frames += 1
        for instance in problem.instances:
            if instance.hypotheses and instance.T_cam_obj_gt is not None:
                model = problem.models[instance.obj_id]
                row.errors.append(pose_errors(model, instance.hypotheses[0].T_cam_obj, instance.T_cam_obj_gt))
    return row


def solved(name: str, raw: dict[str, Any], seeds: int, hypotheses: int) -> Row:
    """The method's answers on all frames."""
    budget = ITERATIONS * hypotheses
    method = {**raw.get("method", {}), "name": name, "iterations": budget if name in SINGLE else ITERATIONS}
    row = Row(name)
    problems: dict[int, Problem] = {}
    for seeded, frame in frames_of(raw, seeds):
        box = Toolbox(resolve({**seeded, "method": method, "mcts": {"expansions": budget}}))
        problem = box.problem(frame)
        box.prepare(problem)
        counted = Counted(box.refiner)
        if not method_of(name).has_tree:  # A tree search brings trimmed ICP.
            box = box.refined_by(counted)
        if row.n_frames == 0:
            box.run(problem).finish()  # compiles kernels, builds what is built once
            counted.calls = 0
        began = perf_counter()
        run = box.run(problem)
        final = run.finish()
        row.seconds += perf_counter() - began
        row.calls += counted.calls or run.length
        row.n_frames += 1
        problems[len(problems)] = problem
        for target, best in zip(problem.targets, final.best, strict=True):
            if best is not None and target.instance.T_cam_obj_gt is not None:
                row.errors.append(pose_errors(target.model, best.T_cam_obj, target.instance.T_cam_obj_gt))
    return row


def sessions(preset: str, refiner: str, dataset: Path | None) -> Iterator[tuple[str, dict[str, Any], int]]:
    """(title, session, hypotheses per object) of every table."""
    disturbed = {"source": "perturb", "rotation_deg": 30, "translation_mm": 30, "max_per_object": 5}
    common: dict[str, Any] = {"preset": preset, "method": {"refiner": refiner}}
    for demo in ("clutter", "stack"):
        yield f"demo {demo}", {**common, "scene": {"demo": demo}, "hypotheses": disturbed}, 5
    if dataset is not None:
        scene = {"source": "bop", "dataset": str(dataset)}
        yield f"{dataset.name}, disturbed ground truth", {**common, "scene": scene, "hypotheses": disturbed}, 5
        files = [str(dataset / "pose_estimates" / f"{name}.csv") for name in ESTIMATORS]
        pools = {"source": "results", "files": files}
        keyed = {**scene, "frames": ["49/2365", "50/1"]}
        yield f"{dataset.name}, estimators' pools", {**common, "scene": keyed, "hypotheses": pools}, 3


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", type=lambda text: Path(text).resolve())
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--preset", choices=tuple(PRESETS), default="recommended")
    parser.add_argument("--refiner", default="icp")
    parser.add_argument("--methods", nargs="+", default=METHODS)
    parser.add_argument("--only", default="", help="tables whose title holds this word")
    a = parser.parse_args()
    for title, raw, hypotheses in sessions(a.preset, a.refiner, a.dataset):
        if a.only in title:
            seeds = a.seeds if raw["hypotheses"]["source"] == "perturb" else 1
            rows = [initial_poses(raw, seeds), *(solved(name, raw, seeds, hypotheses) for name in a.methods)]
            show(f"{title}, {a.preset}, {a.refiner}", rows)


if __name__ == "__main__":
    main()
