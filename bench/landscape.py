"""Milliseconds for what the image allows, at ground truth of the built-in scenes mug and clutter, and for the page's
curves and maps around it.

One thread, as a batch's worker has, is that of the ``NUMBA_NUM_THREADS`` variable.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from statistics import median
from time import perf_counter
from typing import Any

from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.evaluation.depth_noise import ScoreNoise
from verefine_viz.evaluation.landscape import landscape, score_slice
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

REPEATS = 7


def run() -> list[dict[str, Any]]:
    """A row per object."""
    rows: list[dict[str, Any]] = []
    for name in ("mug", "clutter"):
        toolbox = Toolbox(
            resolve(
                {"scene": {"source": "demo", "demo": name}, "method": {"refiner": "icp"}, "physics": {"enabled": False}}
            )
        )
        verifier = toolbox.verifier
        for target in toolbox.problem(toolbox.frames[0]).targets:
            T = target.instance.T_cam_obj_gt
            assert T is not None
            allowed = allowed_poses(verifier, target, T)
            rows.append(
                {
                    "object": target.model.name,
                    "noise, ms": _median_ms(partial(ScoreNoise, verifier, target, T)),
                    "allowed poses, ms": _median_ms(partial(allowed_poses, verifier, target, T)),
                    "curves, ms": _median_ms(partial(landscape, verifier, target, allowed)),
                    "slice, ms": _median_ms(partial(score_slice, verifier, target, allowed, 5, 0)),
                    "undetermined, °": allowed.undetermined_deg,
                    "undetermined, mm": allowed.undetermined_mm,
                }
            )
    return rows


def _median_ms(call: Callable[[], object]) -> float:
    times: list[float] = []
    for _ in range(REPEATS):
        started = perf_counter()
        call()
        times.append(1e3 * (perf_counter() - started))
    return median(times)
