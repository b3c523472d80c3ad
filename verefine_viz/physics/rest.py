"""Let an object fall until it lies still: how demo scenes are laid out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed
from verefine_viz.core.protocols import Simulator
from verefine_viz.core.simulated import SimulatedPath


def settle_to_rest(
    simulator: Simulator,
    moving: Placed,
    fixed: Sequence[Placed],
    support: Support,
    max_steps: int = 600,
    still_steps: int = 15,
    still_m: float = 2e-4,
) -> SimulatedPath:
    """The path of ``moving`` from a drop until it lies still.

    Args:
        simulator: the simulator; its steps are 1/60 s by default.
        moving: the object and the pose it is let go in.
        fixed: what lies there already.
        support: plane and gravity.
        max_steps: give up after so many steps; the path then ends in motion. 600 are 10 s.
        still_steps: it lies still when over so many steps …
        still_m: … no vertex of it moved further than this [m].

    Returns:
        The path up to the first moment at which it had lain still.
    """
    n_steps = min(60, max_steps)
    # Answers depend on the arguments only, so a longer path starts with the shorter one: run again, twice as long.
    while True:
        path = simulator.settle(moving, fixed, support, n_steps)
        end = _first_still(path.Ts_cam_obj, moving.model.vertices, still_steps, still_m)
        if end is not None:
            return SimulatedPath(path.Ts_cam_obj[: end + 1], path.contacts[:end])
        if n_steps >= max_steps:
            return path
        n_steps = min(2 * n_steps, max_steps)


def _first_still(Ts: Float, vertices: Float, still_steps: int, still_m: float) -> int | None:
    """Index of the first pose that differs little from all of the ``still_steps`` poses before it."""
    corners = np.array(np.meshgrid(*zip(vertices.min(axis=0), vertices.max(axis=0), strict=True))).reshape(3, -1)
    tracks = Ts[:, :3, :3] @ corners + Ts[:, :3, 3:]
    for end in range(still_steps, len(Ts)):
        moved_m = np.linalg.norm(tracks[end - still_steps : end] - tracks[end], axis=1)
        if moved_m.max() <= still_m:
            return end
    return None
