"""How far ADD(-S) over points sampled on the surface is from ADD(-S) over the mesh's vertices, as BOP has it.

``python -m bench.error_points DATASET [--poses 10] [--seed 0]``: random poses of every object, each moved and turned
until its ADD(-S) is 10 % of the diameter, where it decides what is right.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, random_unit_vector, transform
from verefine_viz.core.settings import Session
from verefine_viz.evaluation.bop_model import EvalModel, EvalModels
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.evaluation.vertex_errors import add_mm, adi_mm
from verefine_viz.scenes.models import ModelLibrary


def official_mm(model: EvalModel, T_est: Float, T_gt: Float) -> float:
    """ADD(-S) over all vertices [mm]."""
    error = adi_mm if model.is_symmetric else add_mm
    return error(model, T_est[:3, :3], 1e3 * T_est[:3, 3], T_gt[:3, :3], 1e3 * T_gt[:3, 3])


def disturbed(rng: np.random.Generator, model: EvalModel, T_gt: Float) -> Float:
    """A pose that is about 10 % of the diameter off: turned and moved by the same share of a random limit."""
    turn, shift = random_unit_vector(rng), random_unit_vector(rng)
    most_rad, most_m = rng.uniform(0.0, 1.0), rng.uniform(0.0, 0.2) * model.diameter_mm * 1e-3

    def moved(much: float) -> Float:
        return transform(axis_angle(turn, much * most_rad) @ T_gt[:3, :3], T_gt[:3, 3] + much * most_m * shift)

    low, high = 0.0, 3.0
    for _ in range(12):
        middle = (low + high) / 2
        is_near = official_mm(model, moved(middle), T_gt) < CORRECT * model.diameter_mm
        low, high = (middle, high) if is_near else (low, middle)
    return moved((low + high) / 2)


def main() -> None:
    """Prints quantiles of the difference, as a share of the official error."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--poses", type=int, default=10, help="of each object")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    official = EvalModels(arguments.dataset)
    sampled = ModelLibrary(arguments.dataset, Session().scene.model_points, arguments.seed)
    rng = np.random.default_rng(arguments.seed)
    differences: list[float] = []
    for obj_id in sampled.ids:
        model = official.get(obj_id)
        for _ in range(arguments.poses):
            T_gt = transform(axis_angle(random_unit_vector(rng), rng.uniform(0.0, np.pi)), [0.0, 0.0, 1.0])
            T_est = disturbed(rng, model, T_gt)
            differences.append(add_s_mm(sampled.get(obj_id), T_est, T_gt) / official_mm(model, T_est, T_gt) - 1)
    shares = np.abs(differences)
    print(
        f"{len(shares)} poses of {len(sampled.ids)} objects: they differ by {np.median(shares):.1%} in the median, by"
    )
    print(f"{np.quantile(shares, 0.9):.1%} or less for nine in ten, by {shares.max():.1%} at most;")
    print(f"{np.mean(np.array(differences) < 0):.0%} are smaller over sampled points.")


if __name__ == "__main__":
    main()
