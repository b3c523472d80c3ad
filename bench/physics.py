"""What the physics step costs: milliseconds per settle, and how much of it is contacts and records.

Run with ``python -m bench.physics``.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import trimesh

from verefine_viz.core.geometry import axis_angle, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.simulator import BulletSimulator

T_CAM_WORLD = transform(axis_angle([1, 0, 0], np.deg2rad(120)), [0, 0, 0.8])
TABLE = Support(inverse(T_CAM_WORLD), np.array([0.0, 0.0, 1.0]), "plane", 0.9)


def run() -> list[dict[str, Any]]:
    """One row per measurement: what, and the median and fastest milliseconds per call."""
    brick = _placed(trimesh.creation.box([0.06, 0.04, 0.1]), [0, 0, 0.05], 0)
    ring = trimesh.creation.annulus(0.04, 0.06, 0.05)
    fixed = (_placed(ring, [0.035, 0, 0.025], 1), _placed(ring, [-0.035, 0.11, 0.025], 2))
    moving = _placed(ring, [0, 0.02, 0.0751], 0)
    simulator = BulletSimulator(PhysicsSettings())
    rows = []
    casts: list[tuple[str, Placed, tuple[Placed, ...]]] = [("1 box", brick, ()), ("3 decomposed rings", moving, fixed)]
    for name, body, others in casts:
        touching = np.mean([len(c.others) for c in simulator.settle(body, others, TABLE, 60).contacts])
        for n_steps in (3, 60):
            settle = partial(simulator.settle, body, others, TABLE, n_steps)
            row = _row(f"settle, {name}, {n_steps} steps", settle)
            rows.append(row | {"contacts_per_step": round(float(touching), 1)})
        # The same steps without asking for contacts: the difference to the rows above is their cost and the records'.
        world = simulator._world
        rows.append(_row(f"Bullet alone, {name}, 3 steps", lambda w=world: [w.step() for _ in range(3)]))
    rows.append(_row("settle in free fall, 3 steps", lambda: simulator.settle(_lifted(brick), (), TABLE, 3)))
    rows.append(_row("plausibility, 1 box", lambda: plausibility(brick, (), TABLE), calls=10))
    rows.append(_row("plausibility, 3 rings", lambda: plausibility(moving, fixed, TABLE), calls=3))
    return rows


def _row(what: str, call: Callable[[], object], calls: int = 30) -> dict[str, Any]:
    call()
    times_ms = []
    for _ in range(calls):
        start = time.perf_counter()
        call()
        times_ms.append((time.perf_counter() - start) * 1e3)
    return {"what": what, "median_ms": round(float(np.median(times_ms)), 4), "fastest_ms": round(min(times_ms), 4)}


def _placed(mesh: trimesh.Trimesh, t_world: list[float], instance_id: int) -> Placed:
    vertices = np.asarray(mesh.vertices)
    diameter_m = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    no_normals = np.array([[0.0, 0.0, 1.0]])
    model = ObjectModel(
        1, "bench", vertices, np.asarray(mesh.faces), vertices[:1], no_normals, diameter_m, np.eye(4)[None]
    )
    return Placed(instance_id, model, T_CAM_WORLD @ transform(np.eye(3), t_world))


def _lifted(placed: Placed) -> Placed:
    return Placed(placed.instance_id, placed.model, T_CAM_WORLD @ transform(np.eye(3), [0, 0, 0.5]))


if __name__ == "__main__":
    for line in run():
        print(json.dumps(line))
