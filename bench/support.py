"""Ground truth of real frames on the support plane and in observed surroundings: what sinks, what floats, and why; and
what a simulation costs.

Run with ``python -m bench.support DATASET``, a BOP folder with ground truth.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.core.surroundings import SUPPORT_ID
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.proximity import Surfaces
from verefine_viz.physics.simulator import BulletSimulator, plane_of
from verefine_viz.session.files import resolve
from verefine_viz.session.toolbox import Toolbox

OFF_MM = 3.0
"""Ground truth that sinks or floats by more counts."""
BASE_DEG = 15.0
"""A face of the model's hull that leans less is what the object stands on [deg]."""
REPEATS = 20


@dataclass(frozen=True)
class Standing:
    """How the ground truth of an object meets what supports it."""

    gap_mm: float
    penetration_mm: float
    """Into the support; neighbours aside."""
    settle_ms: float
    """Processor time of a simulation of 3 steps."""


def standing(placed: Placed, others: Sequence[Placed], support: Support, surfaces: Surfaces) -> Standing:
    """Of one object among the others."""
    found = plausibility(placed, others, support, surface_of=surfaces)
    sinks = found.penetration_mm if found.penetrates == SUPPORT_ID else 0.0
    simulator = SIMULATOR
    simulator.settle(placed, others, support, 3)
    started = time.process_time()
    for _ in range(REPEATS):
        simulator.settle(placed, others, support, 3)
    return Standing(found.gap_mm, sinks, 1e3 * (time.process_time() - started) / REPEATS)


SIMULATOR = BulletSimulator(resolve({"physics": {"collider": "hull"}}).physics)


def base_of(model: ObjectModel, T_world_obj: Float) -> tuple[float, float, float] | None:
    """The face of the hull that the object stands on: height of its middle and of its lowest corner [m], and its angle
    to level [deg]; None where it stands on none, as a banana does.
    """
    hull = trimesh.convex.convex_hull(model.vertices)
    normals = np.asarray(hull.face_normals) @ T_world_obj[:3, :3].T
    down = np.flatnonzero(-normals[:, 2] >= np.cos(np.radians(BASE_DEG)))
    if not len(down):
        return None
    areas = np.asarray(hull.area_faces)[down]
    normal = (areas[:, None] * normals[down]).sum(axis=0)
    middle = apply(T_world_obj, np.asarray(hull.triangles_center)[down])
    heights = apply(T_world_obj, np.asarray(hull.vertices)[np.unique(hull.faces[down])])[:, 2]
    tilt_deg = float(np.degrees(np.arccos(-normal[2] / np.linalg.norm(normal))))
    return float((areas * middle[:, 2]).sum() / areas.sum()), float(heights.min()), tilt_deg


def surface_mm(problem: Problem, support: Support, xy: Float) -> float:
    """Median height [mm] of what was measured of the support around a place (2,), above the support plane."""
    observation = problem.observation
    clear = (observation.depth_m > 0) & ~observation.object_mask
    points = apply(support.T_world_cam, observation.camera.back_project(observation.depth_m.astype(float))[clear])
    heights = plane_of(support).heights(points)
    near = (np.linalg.norm(points[:, :2] - xy, axis=1) < 0.12) & (np.abs(heights) < 0.02)
    return 1e3 * float(np.median(heights[near])) if near.any() else float("nan")


def main(dataset: Path) -> None:
    """Prints a row per object, and totals."""
    box = Toolbox(
        resolve({"scene": {"source": "bop", "dataset": str(dataset.resolve())}, "physics": {"enabled": False}})
    )
    observed = box.restarted({"physics": {"support": "observed"}})
    surfaces, every = Surfaces(), []
    print("frame      object                  plane: gap sinks | observed: gap sinks | table  base   lowest  lean")
    for frame in box.frames:
        problem = box.source.problem(frame)
        support = problem.observation.support
        around = observed.surrounded(problem).observation.support
        placed = [
            Placed(t.instance.instance_id, t.model, t.instance.T_cam_obj_gt)
            for t in problem.targets
            if t.instance.T_cam_obj_gt is not None
        ]
        if support is None or around is None:
            continue
        plain = replace(support, surroundings=None)
        for one in placed:
            others = [other for other in placed if other is not one]
            on_plane, in_world = (standing(one, others, s, surfaces) for s in (plain, around))
            every.append((on_plane, in_world))
            T_world_obj = support.T_world_cam @ one.T_cam_obj
            base = base_of(one.model, T_world_obj)
            table_mm = surface_mm(problem, support, T_world_obj[:2, 3])
            words = f"{1e3 * base[0]:6.1f} {1e3 * base[1]:7.1f} {base[2]:5.1f}°" if base is not None else ""
            print(
                f"{frame:10} {one.model.name[:22]:22} {on_plane.gap_mm:10.1f} {on_plane.penetration_mm:5.1f} |"
                f" {in_world.gap_mm:13.1f} {in_world.penetration_mm:5.1f} | {table_mm:5.1f} {words}"
            )
    for k, name in enumerate(("plane", "observed")):
        sinks = sum(pair[k].penetration_mm > OFF_MM for pair in every)
        floats = sum(pair[k].gap_mm > OFF_MM for pair in every)
        print(f"{name}: of {len(every)}, {sinks} sink and {floats} float by more than {OFF_MM:g} mm")
    times = np.array([[a.settle_ms, b.settle_ms] for a, b in every])
    ratios = times[:, 1] / times[:, 0]
    print(
        f"a simulation of 3 steps: {times[:, 0].mean():.2f} / {times[:, 1].mean():.2f} ms of processor time, "
        f"{times[:, 1].sum() / times[:, 0].sum():.2f} times as long; objects {ratios.min():.2f} to {ratios.max():.2f}"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
