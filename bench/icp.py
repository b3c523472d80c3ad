"""Milliseconds per ICP call: 1000 observed points on a model of 2000, against others in the same run.

ICP runs 10 iterations and is compared with Open3D, trimmed ICP runs to convergence and is compared with the same passes
in numpy and scipy. Those build their search tree in every call; ours is built once per model, which has its own row.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import msgspec
import numpy as np
import open3d as o3d
from scipy.spatial import KDTree

from tests.refiners.alignment import Cloud, icp_align, trimmed_align
from verefine_viz.core.algorithm_settings import IcpSettings, TricpSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, inverse, nearest_rotation, transform
from verefine_viz.core.settings import PUBLISHED
from verefine_viz.refiners.icp import largest_extent_m

N_SOURCE, N_TARGET, N_ITERATIONS = 1000, 2000, 10
REPEATS = 60


def run() -> list[dict[str, Any]]:
    """A row per case and implementation."""
    rng = np.random.default_rng(0)
    model, normals = _box(rng, N_TARGET)
    seen, seen_normals = _box(rng, 3 * N_SOURCE)
    front = np.flatnonzero(seen_normals @ [0.5, 0.6, 0.62] > 0)[:N_SOURCE]
    target = Cloud(model, normals)
    plain = IcpSettings(gate="published", matches="all")
    cases: list[tuple[str, IcpSettings]] = [
        ("as open3d: fixed gate, all matches", plain),
        ("default: shrinking gate, same side", IcpSettings()),
        ("default, point to plane", IcpSettings(metric="plane")),
        ("published: stops after 2", msgspec.convert(PUBLISHED["icp"], IcpSettings)),
    ]
    rows: list[dict[str, Any]] = [
        {
            "start": "",
            "icp": "index of a model, built once",
            "iterations": None,
            "ms per call": _median_ms(lambda: Cloud(model, normals), 5),
        }
    ]
    for start, angle_deg, shift_m in (("5° 5 mm", 5, 0.005), ("30° 30 mm", 30, 0.030), ("30° 300 mm", 30, 0.3)):
        T = transform(axis_angle([1, 2, 3], np.deg2rad(angle_deg)), np.array([0.6, -0.48, 0.64]) * shift_m)
        # In reading order, as a cloud from an image is.
        order = np.lexsort((seen[front, 0], np.round(seen[front, 1], 2)))
        source = apply(inverse(T), seen[front][order]) + rng.normal(0, 0.0005, (N_SOURCE, 3))
        source_normals = seen_normals[front][order] @ T[:3, :3]
        for trim in (1.0, 0.7):
            rows += _trimmed(start, source, model, target, TricpSettings(trim=trim))
        if shift_m > 0.1:
            continue  # nothing lies within ICP's gate
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
        "times faster than open3d, numpy": open3d_ms / ms,
    }


def _trimmed(start: str, source: Float, model: Float, target: Cloud, settings: TricpSettings) -> list[dict[str, Any]]:
    """Trimmed ICP in numpy and ours, measured in turns; they agree."""
    calls = (lambda: _numpy_trimmed(source, model, settings), lambda: trimmed_align(source, target, settings))
    (T, n_passes), ours = calls[0](), calls[1]()
    assert n_passes == ours.n_iterations
    assert np.abs(T - ours.T_target_source).max() < 1e-9
    theirs_ms, ours_ms = (float(np.median(times)) for times in zip(*(map(_ms, calls) for _ in range(20)), strict=True))
    name = f"trimmed ICP, trim {settings.trim:g}"
    return [
        _row(start, f"{name}, numpy and scipy", n_passes, theirs_ms, theirs_ms),
        _row(start, name, ours.n_iterations, ours_ms, theirs_ms),
    ]


def _numpy_trimmed(source: Float, model: Float, settings: TricpSettings) -> tuple[Float, int]:
    """docs/methods.md 4.2 in a few lines."""
    tree, n_used = KDTree(model), int(settings.trim * len(source))
    T, energy, n_passes = np.eye(4), np.inf, 0
    while n_passes < settings.max_passes:
        distance, match = map(np.asarray, tree.query(apply(T, source)))
        used = np.argsort(distance, kind="stable")[:n_used]
        a, b = source[used], model[match[used]]
        R = nearest_rotation((b - b.mean(0)).T @ (a - a.mean(0)))
        T = transform(R, b.mean(0) - R @ a.mean(0))
        n_passes, previous, energy = n_passes + 1, energy, float((distance[used] ** 2).sum())
        if not energy < settings.energy_ratio * previous:
            break
    return T, n_passes


def _ms(call: Callable[[], object]) -> float:
    started = perf_counter()
    call()
    return 1e3 * (perf_counter() - started)


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
    return float(np.median([_ms(call) for _ in range(repeats)]))
