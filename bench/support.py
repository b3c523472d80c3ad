"""Ground truth of real frames on the support plane and in observed surroundings: what sinks, what floats, and why; and
what a simulation costs.

Run with ``python -m bench.support DATASET``, a BOP folder with ground truth.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_erosion

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.surroundings import SUPPORT_ID
from verefine_viz.diagnosis.measured_heights import base_of
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.proximity import Surfaces
from verefine_viz.physics.simulator import BulletSimulator, plane_of
from verefine_viz.rendering.rendered_scene import render_scene
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

OFF_MM = 3.0
"""Ground truth that sinks or floats by more counts."""
ROUNDS, REPEATS = 5, 10
"""The fastest of so many rounds of so many simulations counts: other programs run as well."""


def settle_ms(simulator: BulletSimulator, placed: Placed, others: Sequence[Placed], support: Support) -> float:
    """Processor time of a simulation of 3 steps, in this thread: those of a ray caster before it still spin."""
    rounds = []
    for _ in range(ROUNDS):
        started = time.thread_time()
        for _ in range(REPEATS):
            simulator.settle(placed, others, support, 3)
        rounds.append(time.thread_time() - started)
    return 1e3 * min(rounds) / REPEATS


def base_row(placed: Placed, T_world_obj: Float, support: Support) -> str:
    """What the object stands on: height of its middle and of the lowest vertex [mm], and its angle to level; empty
    where it stands on nothing level.
    """
    base = base_of(placed.model, placed.T_cam_obj, support)
    if base is None:
        return ""
    lowest_m = apply(T_world_obj, placed.model.vertices)[:, 2].min()
    return f"{1e3 * base.middle_m:6.1f} {1e3 * lowest_m:7.1f} {np.hypot(*base.lean_deg):5.1f}°"


def table_mm(problem: Problem, support: Support, xy: Float) -> float:
    """Median height of what was measured of the support around a place (2,), above the support plane."""
    observation = problem.observation
    clear = (observation.depth_m > 0) & ~observation.object_mask
    points = apply(support.T_world_cam, observation.camera.back_project(observation.depth_m.astype(float))[clear])
    heights = plane_of(support).heights(points)
    near = (np.linalg.norm(points[:, :2] - xy, axis=1) < 0.12) & (np.abs(heights) < 0.02)
    return 1e3 * float(np.median(heights[near])) if near.any() else float("nan")


def top_mm(target: Target, placed: Placed, support: Support) -> float:
    """Median distance of the measured upward faces from those of ground truth, positive above."""
    observation = target.observation
    rendered, camera = render_scene([placed], observation.camera), observation.camera
    both = target.instance.mask & (observation.depth_m > 0) & (rendered.depth_m > 0)
    inside = np.asarray(binary_erosion(both, iterations=4), dtype=bool)
    normals = np.asarray(rendered.normals_cam)[inside]
    measured, true = (camera.back_project(d.astype(float))[inside] for d in (observation.depth_m, rendered.depth_m))
    off = ((measured - true) * normals).sum(axis=1)[normals @ support.T_world_cam[2, :3] > 0.85]
    return 1e3 * float(np.median(off)) if len(off) > 30 else float("nan")


def main(dataset: Path) -> None:
    """Prints a row per object, and totals."""
    scene = {"scene": {"source": "bop", "dataset": str(dataset.resolve())}, "physics": {"enabled": False}}
    box = Toolbox(resolve(scene))
    observed = box.restarted({"physics": {"support": "observed"}})
    simulator, surfaces = BulletSimulator(resolve({"physics": {"collider": "hull"}}).physics), Surfaces()
    rows: list[list[float]] = []
    making_s: list[float] = []
    columns = "gap sinks   ms"
    print(f"frame      object               plane: {columns}  observed: {columns} | table   top   base     low  lean")
    for frame in box.frames:
        problem = box.source.problem(frame)
        started = time.process_time()
        around = observed.surrounded(problem).observation.support
        making_s.append(time.process_time() - started)
        support = problem.observation.support
        if support is None or around is None:
            continue
        placed = [
            Placed(t.instance.instance_id, t.model, t.instance.T_cam_obj_gt)
            for t in problem.targets
            if t.instance.T_cam_obj_gt is not None
        ]
        for one in placed:
            others = [other for other in placed if other is not one]
            row: list[float] = []
            for world in (support, around):
                checked = plausibility(one, others, world, surface_of=surfaces)
                sinks_mm = checked.penetration_mm if checked.penetrates == SUPPORT_ID else 0.0
                row += [checked.gap_mm, sinks_mm, settle_ms(simulator, one, others, world)]
            rows.append(row)
            T_world_obj = support.T_world_cam @ one.T_cam_obj
            numbers = "  ".join(f"{gap:13.1f} {sinks:5.1f} {ms:4.2f}" for gap, sinks, ms in (row[:3], row[3:]))
            heights_mm = (
                table_mm(problem, support, T_world_obj[:2, 3]),
                top_mm(problem.target(one.instance_id), one, support),
            )
            ground = f"{heights_mm[0]:5.1f} {heights_mm[1]:5.1f} {base_row(one, T_world_obj, support)}"
            print(f"{frame:10} {one.model.name[:19]:19} {numbers} | {ground}")
    gaps, sinks, times = (np.array(rows)[:, k::3] for k in range(3))
    for k, name in enumerate(("plane", "observed")):
        n_sink, n_float = (np.count_nonzero(mm[:, k] > OFF_MM) for mm in (sinks, gaps))
        print(f"{name}: of {len(rows)}, {n_sink} sink and {n_float} float by more than {OFF_MM:g} mm")
    ratios = times[:, 1] / times[:, 0]
    print(
        f"a simulation of 3 steps: {times[:, 0].mean():.2f} / {times[:, 1].mean():.2f} ms of processor time; times as "
        f"long: {ratios.min():.2f} to {ratios.max():.2f}, mean {ratios.mean():.2f}; surroundings of a frame, once: "
        f"{min(making_s):.1f} to {max(making_s):.1f} s"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
