"""Milliseconds per ICP call of 10 iterations: 1000 observed points on a model of 2000, against Open3D in one run.

Open3D builds its search tree in every call; ours is built once per model, which has its own row.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
import open3d as o3d

from verefine_viz.core.geometry import apply, axis_angle, inverse, transform
from verefine_viz.core.settings import PUBLISHED, IcpSettings
from verefine_viz.refiners.icp import IcpTarget, icp_align, largest_extent_m

N_SOURCE, N_TARGET, N_ITERATIONS = 1000, 2000, 10
REPEATS = 60


def run() -> list[dict[str, Any]]:
    """A row per case and implementation."""
    rng = np.random.default_rng(0)
    model, normals = _box(rng, N_TARGET)
    seen, seen_normals = _box(rng, 3 * N_SOURCE)
    front = np.flatnonzero(seen_normals @ [0.5, 0.6, 0.62] > 0)[:N_SOURCE]
    target = IcpTarget.build(model, normals)
    plain = IcpSettings(gate="published", matches="all")
    cases: list[tuple[str, IcpSettings]] = [
        ("as open3d: fixed gate, all matches", plain),
        ("default: shrinking gate, same side", IcpSettings()),
        ("default, point to plane", IcpSettings(metric="plane")),
        ("published: stops after 2", IcpSettings.model_validate(PUBLISHED["icp"])),
    ]
    rows: list[dict[str, Any]] = [
        {
            "start": "",
            "icp": "index of a model, built once",
            "iterations": None,
            "ms per call": _median_ms(lambda: IcpTarget.build(model, normals), 5),
        }
    ]
    for start, angle_deg, shift_m in (("5° 5 mm", 5, 0.005), ("30° 30 mm", 30, 0.030)):
        T = transform(axis_angle([1, 2, 3], np.deg2rad(angle_deg)), np.array([0.6, -0.48, 0.64]) * shift_m)
        # In reading order, as a cloud from an image is.
        order = np.lexsort((seen[front, 0], np.round(seen[front, 1], 2)))
        source = apply(inverse(T), seen[front][order]) + rng.normal(0, 0.0005, (N_SOURCE, 3))
        source_normals = seen_normals[front][order] @ T[:3, :3]
        theirs = _median_ms(_open3d_call(source, model, 0.1 * largest_extent_m(source)))
        rows.append(_row(start, "open3d registration_icp", N_ITERATIONS, theirs, theirs))
        for name, settings in cases:

            def ours(
                source: np.ndarray = source, settings: IcpSettings = settings, n: np.ndarray = source_normals
            ) -> int:
                return icp_align(source, target, settings, source_normals=n).n_iterations

            rows.append(_row(start, name, ours(), _median_ms(ours), theirs))
    return rows


def _row(start: str, name: str, n_iterations: int, ms: float, open3d_ms: float) -> dict[str, Any]:
    return {
        "start": start,
        "icp": name,
        "iterations": n_iterations,
        "ms per call": ms,
        "times faster than open3d": open3d_ms / ms,
    }


def _box(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and outward normals on a box of 100 × 160 × 60 mm."""
    half = np.array([0.05, 0.08, 0.03])
    points = rng.uniform(-1, 1, (n, 3)) * half
    areas = np.array([half[1] * half[2], half[0] * half[2], half[0] * half[1]])
    axis, sign = rng.choice(3, n, p=areas / areas.sum()), rng.choice([-1.0, 1.0], n)
    points[np.arange(n), axis] = sign * half[axis]
    normals = np.zeros((n, 3))
    normals[np.arange(n), axis] = sign
    return points, normals


def _open3d_call(source: np.ndarray, target: np.ndarray, gate_m: float) -> Callable[[], object]:
    registration = o3d.pipelines.registration
    moving = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(source))
    fixed = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(target))
    stop = registration.ICPConvergenceCriteria(0, 0, N_ITERATIONS)
    point = registration.TransformationEstimationPointToPoint()
    return lambda: registration.registration_icp(moving, fixed, gate_m, np.eye(4), point, stop)


def _median_ms(call: Callable[[], object], repeats: int = REPEATS) -> float:
    for _ in range(3):
        call()
    times = []
    for _ in range(repeats):
        started = perf_counter()
        call()
        times.append(perf_counter() - started)
    return 1e3 * float(np.median(times))
