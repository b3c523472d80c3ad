"""Accuracy on real frames: the estimators' poses and disturbed ground truth, before and after each method.

    python -m bench.real_frames DATASET_FOLDER [--seeds 3]

prints the tables that docs/measured.md has. DATASET_FOLDER is a BOP data set with ``pose_estimates/*.csv``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from rich.console import Console
from rich.table import Table

from verefine_viz.core.accuracy import PoseErrors
from verefine_viz.core.problem import Problem
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

METHODS = ("refine", "phys_before", "phys_after", "pir", "sir", "even", "expl", "rir", "vf_depth")
SINGLE = ("refine", "phys_before", "phys_after", "pir", "sir")
"""Methods that use one hypothesis: they get the whole budget of H·K refiner calls."""


@dataclass(frozen=True)
class Row:
    """One method on many instances."""

    name: str
    errors: tuple[PoseErrors, ...]
    ms_per_object: float

    def cells(self) -> list[str]:
        add = np.array([e.add_s_mm for e in self.errors])
        return [
            self.name,
            str(len(add)),
            f"{np.median(add):.1f}",
            f"{add.mean():.1f}",
            f"{np.median([e.rotation_deg for e in self.errors]):.1f}",
            f"{np.median([e.translation_mm for e in self.errors]):.1f}",
            f"{100 * np.mean([e.is_correct for e in self.errors]):.0f}",
            f"{self.ms_per_object:.0f}",
        ]


def show(title: str, rows: Iterable[Row]) -> None:
    """One table on the terminal."""
    table = Table(title=title)
    for heading in (
        "",
        "n",
        "median ADD(-S) mm",
        "mean",
        "median rot °",
        "median trans mm",
        "< 10 % d, %",
        "ms/object",
    ):
        table.add_column(heading, justify="left" if not heading else "right")
    for row in rows:
        table.add_row(*row.cells())
    Console(width=120).print(table)


def solved(name: str, raw: dict[str, object], problems: list[Problem], toolbox: Toolbox) -> Row:
    """The method's answers on all problems, with the session ``raw`` otherwise."""
    box = toolbox.changed({"method": raw})  # type: ignore[arg-type]
    errors: list[PoseErrors] = []
    seconds = 0.0
    for problem in problems:
        began = perf_counter()
        final = box.run(problem).finish()
        seconds += perf_counter() - began
        for target, best in zip(problem.targets, final.best, strict=True):
            if best is not None and target.instance.T_cam_obj_gt is not None:
                errors.append(pose_errors(target.model, best.T_cam_obj, target.instance.T_cam_obj_gt))
    return Row(name, tuple(errors), 1e3 * seconds / max(len(errors), 1))


def before(problems: list[Problem]) -> list[Row]:
    """The hypotheses themselves: by source, and the best and the mean of each pool."""
    by_source: dict[str, list[PoseErrors]] = {}
    oracle: list[PoseErrors] = []
    for problem in problems:
        for target in problem.targets:
            T_gt = target.instance.T_cam_obj_gt
            if T_gt is None or not target.instance.hypotheses:
                continue
            found = [pose_errors(target.model, h.T_cam_obj, T_gt) for h in target.instance.hypotheses]
            for h, e in zip(target.instance.hypotheses, found, strict=True):
                by_source.setdefault(h.source.split(" #")[0], []).append(e)
            oracle.append(min(found, key=lambda e: e.add_s_mm))
    rows = [Row(f"{source}, alone", tuple(e), 0) for source, e in by_source.items()]
    return [*rows, Row("best of the pool (oracle)", tuple(oracle), 0)]


def table(title: str, raw: dict[str, object], pool: int, seeds: int) -> None:
    """The table of all methods for one kind of hypotheses."""
    problems: list[Problem] = []
    toolbox = None
    for seed in range(seeds):
        hypotheses = {**raw["hypotheses"], "seed": seed}  # type: ignore[dict-item]
        toolbox = Toolbox(resolve({**raw, "hypotheses": hypotheses}))
        problems += [toolbox.problem(frame) for frame in toolbox.frames]
    assert toolbox is not None
    rows = before(problems)
    for name in METHODS:
        iterations = 5 * pool if name in SINGLE else 5
        rows.append(solved(name, {"name": name, "iterations": iterations}, problems, toolbox))
    show(title, rows)


def one_by_one(raw: dict[str, object], files: list[str]) -> list[Row]:
    """Single-hypothesis methods from each estimator's pose, with the budget that the pool has together."""
    rows = []
    for file in files:
        toolbox = Toolbox(resolve({**raw, "hypotheses": {"source": "results", "files": [file]}}))
        problems = [toolbox.problem(frame) for frame in toolbox.frames]
        for name in ("refine", "pir", "sir"):
            label = f"{Path(file).name.split('_')[0]}, {name}"
            rows.append(solved(label, {"name": name, "iterations": 5 * len(files)}, problems, toolbox))
    return rows


def main() -> None:
    """Prints all tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    folder: Path = arguments.dataset.resolve()
    scene = {"source": "bop", "dataset": str(folder)}
    names = ("cosypose_ycbv-test", "posecnn-rss2018_ycbv-test", "sundermeyer_ycbv-test")
    files = [str(folder / "pose_estimates" / f"{name}.csv") for name in names]
    for title, chosen in {
        "recommended": {"preset": "recommended"},
        "recommended with icp": {"preset": "recommended", "method": {"refiner": "icp"}},
        "paper": {"preset": "paper"},
        "published": {"preset": "published"},
    }.items():
        estimators = {
            **chosen,
            "scene": {**scene, "frames": ["49/2365", "50/1"]},
            "hypotheses": {"source": "results", "files": files},
        }
        table(f"Estimators' poses, key frames, {title}", estimators, 3, 1)
        show(f"One estimator, 15 refiner calls, {title}", one_by_one(estimators, files))
        disturbed = {
            **chosen,
            "scene": scene,
            "hypotheses": {"source": "perturb", "rotation_deg": 30, "translation_mm": 30, "max_per_object": 5},
        }
        table(f"Ground truth disturbed by 30° and 30 mm, 5 hypotheses, {title}", disturbed, 5, arguments.seeds)


if __name__ == "__main__":
    main()
