"""Whether what is stated about the poses that an image allows holds: on real frames, and on made-up ones.

    python -m bench.allowed_poses DATASET_FOLDER [--seeds 5] [--degrees 15 30 45 60] [--causes]

Ground truth is disturbed by each angle and 30 mm, RIR solves it with the recommended settings, and the poses that the
image allows are worked out around each answer and, of wrong ones, around ground truth. DATASET_FOLDER is a BOP data set
whose models have colours; without one only the made-up frames are tried. ``--causes`` diagnoses the wrong answers.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from time import process_time

import numpy as np
from rich.console import Console
from rich.table import Table

from tests.made_up_frames import Thing, frame_of, model, near, session_of, standing
from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem, Target
from verefine_viz.diagnosis.diagnose import diagnose
from verefine_viz.evaluation.allowed_poses import CANNOT_TELL
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.evaluation.pose_errors import add_s_mm, adds_mm
from verefine_viz.evaluation.rotation_errors import symmetric_angles_rad
from verefine_viz.evaluation.seen_error import is_allowed, nearest_allowed
from verefine_viz.run.engine import Run
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

BY_SHAPE = 0.05
"""An answer is right by shape where ADI is below this share of the diameter."""
WIDTHS_DEG = (0.0, 2.0, 5.0, 10.0, 30.0, 181.0)
"""Bins of the stated widths."""


@dataclass(frozen=True)
class Judged:
    """One answer and what was stated about it."""

    name: str
    error: float
    """ADD(-S) as a share of the diameter."""
    error_seen: float
    """ADD(-S) to the nearest pose that the image allows beside ground truth."""
    by_shape: float
    """ADI as a share of the diameter."""
    is_inside: bool
    """Whether ground truth is among the allowed poses."""
    apart: Float
    """(6,) motion from the nearest of them to ground truth, in standard deviations."""
    widths: Float
    """(6,) half of the intervals stated for small motions [mm, deg]."""
    width_deg: float
    """The widest turn."""
    turned_deg: float
    """Error of rotation."""
    ms: float
    """Processor time."""


def judged(toolbox: Toolbox, run: Run, target: Target, T_est: Float) -> Judged:
    """One answer of a run."""
    model_, T_gt = target.model, target.instance.T_cam_obj_gt
    assert T_gt is not None
    diameter_mm = 1e3 * model_.diameter_m
    began = process_time()
    allowed = allowed_poses(toolbox.verifier, target, T_est, (), run.iterations)
    ms = 1e3 * (process_time() - began)
    small, (anchor, _) = allowed.small, nearest_allowed(allowed, model_, T_gt)
    S = model_.symmetries[int(np.argmin(symmetric_angles_rad(model_, anchor, T_gt)))]
    spread = np.sqrt(np.diag(small.covariance))
    error = add_s_mm(model_, T_est, T_gt) / diameter_mm
    seen = error
    if error >= CORRECT:
        of_gt = allowed_poses(toolbox.verifier, target, T_gt, (), run.iterations)
        seen = min(error, nearest_allowed(of_gt, model_, T_est)[1] / diameter_mm)
    offset = small.offset if np.array_equal(anchor, T_est) else np.zeros(6)
    return Judged(
        model_.name,
        error,
        seen,
        adds_mm(model_, T_est, T_gt) / diameter_mm,
        is_allowed(allowed, model_, T_gt),
        (small.six.motion_to(T_gt @ S, anchor) - offset) / spread,
        CANNOT_TELL * spread,
        allowed.undetermined_deg,
        float(np.rad2deg(symmetric_angles_rad(model_, T_est, T_gt).min())),
        ms,
    )


def of_dataset(folder: Path, degrees: float, seeds: int, causes: Counter[str] | None) -> Iterator[Judged]:
    """Answers from ground truth disturbed by an angle and 30 mm; their causes are counted where wanted."""
    for seed in range(seeds):
        toolbox = Toolbox(
            resolve(
                {
                    "scene": {"source": "bop", "dataset": str(folder), "split": "test"},
                    "hypotheses": {
                        "source": "perturb", "rotation_deg": degrees, "translation_mm": 30.0, "max_per_object": 5,
                        "seed": seed,
                    },
                    "method": {"name": "rir", "iterations": 5},
                }
            )
        )  # fmt: skip
        for frame in toolbox.frames:
            yield from of_run(toolbox, toolbox.problem(frame), causes)


def made_up(n: int) -> Iterator[Judged]:
    """Answers on made-up frames of one object each, from starts of 6 mm and 6°."""
    for seed in range(n):
        rng = np.random.default_rng(1000 + seed)
        one = model(["mug", "jug", "carton", "duck"][seed % 4])
        T = standing(one, rng)
        problem = frame_of([Thing(one, T, near(T, rng, 1, 6, 6))], rng)
        toolbox = Toolbox(session_of("sir", 3, method={"refiner": "icp"}, physics={"enabled": False}))
        yield from of_run(toolbox, problem, None)


def of_run(toolbox: Toolbox, problem: Problem, causes: Counter[str] | None) -> Iterator[Judged]:
    """The answers of one frame."""
    run = toolbox.run(problem)
    final = run.finish()
    for target, best in zip(problem.targets, final.best, strict=True):
        if best is not None and target.instance.T_cam_obj_gt is not None:
            yield judged(toolbox, run, target, best.T_cam_obj)
    if causes is not None:
        for one in diagnose(run, toolbox):
            name = problem.target(one.instance_id).model.name
            causes[f"{name}: {one.main.cause}{'' if one.main.is_confirmed else ' (not confirmed)'}"] += 1


def show(rows: dict[str, Sequence[Judged]]) -> None:
    """The tables on the terminal."""
    console = Console(width=150)
    table = Table(title="by shape right answers: is the truth inside, and how wide is what is stated")
    for heading in ("starts", "n", "right %", "right as seen %", "by shape %", "inside %", "of single motions %",
                    "width mm", "width °", "widest turn °", "ms median", "ms 95 %"):  # fmt: skip
        table.add_column(heading, justify="right")
    for name, of in rows.items():
        right = [one for one in of if one.by_shape < BY_SHAPE]
        apart, widths = np.array([one.apart for one in right]), np.array([one.widths for one in right])
        table.add_row(
            name,
            str(len(of)),
            f"{100 * np.mean([one.error < CORRECT for one in of]):.1f}",
            f"{100 * np.mean([one.error_seen < CORRECT for one in of]):.1f}",
            f"{100 * len(right) / len(of):.1f}",
            f"{100 * np.mean([one.is_inside for one in right]):.1f}",
            f"{100 * np.mean(np.abs(apart) < CANNOT_TELL):.1f}",
            f"{np.median(widths[:, :3]):.2f}",
            f"{np.median(widths[:, 3:]):.2f}",
            f"{np.median([one.width_deg for one in right]):.1f}",
            f"{np.median([one.ms for one in of]):.0f}",
            f"{np.quantile([one.ms for one in of], 0.95):.0f}",
        )
    console.print(table)
    every = [one for of in rows.values() for one in of if one.by_shape < BY_SHAPE]
    reliability = Table(title="reliability: the widest turn that is stated, against the error of rotation")
    for heading in ("stated °", "n", "error within %", "median error °", "95 % of errors below °"):
        reliability.add_column(heading, justify="right")
    for low, high in pairwise(WIDTHS_DEG):
        of = [one for one in every if low <= one.width_deg < high]
        if of:
            errors = np.array([one.turned_deg for one in of])
            within = np.mean([one.turned_deg <= one.width_deg for one in of])
            reliability.add_row(
                f"{low:.0f} to {min(high, 180):.0f}", str(len(of)), f"{100 * within:.0f}", f"{np.median(errors):.1f}",
                f"{np.quantile(errors, 0.95):.1f}",
            )  # fmt: skip
    console.print(reliability)


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, nargs="?")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--degrees", type=float, nargs="+", default=[15, 30, 45, 60])
    parser.add_argument("--made-up", type=int, default=40, help="frames")
    parser.add_argument("--causes", action="store_true")
    arguments = parser.parse_args()
    causes: Counter[str] | None = Counter() if arguments.causes else None
    rows: dict[str, Sequence[Judged]] = {}
    for degrees in arguments.degrees if arguments.dataset else ():
        rows[f"{degrees:.0f}°"] = [*of_dataset(arguments.dataset.resolve(), degrees, arguments.seeds, causes)]
        print(f"{degrees:.0f}°: {len(rows[f'{degrees:.0f}°'])} answers", flush=True)
    rows["made up"] = [*made_up(arguments.made_up)]
    show(rows)
    for name, n in (causes or Counter()).most_common():
        print(f"{n:4d} {name}")


if __name__ == "__main__":
    main()
