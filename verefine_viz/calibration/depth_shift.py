"""Checks whether depth lies on models in their poses, in the right unit; else measures by how much it is off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.calibration.seen_object import mesh_of
from verefine_viz.core.arrays import writable
from verefine_viz.core.data_remedies import displaced
from verefine_viz.core.doubt import Doubt, DoubtKind, times_words
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import DataSettings
from verefine_viz.rendering.rasterizer import draw_depth

TAU_M = 0.020
"""Depths that differ by more than this do not agree at all [m]."""
REACH_PX = 40
"""Largest shift that is tried [px]."""
PIXELS = 3000
"""Most pixels of the objects that are compared."""
MEASURED = 0.3
"""Least share of the objects' pixels with depth; below, nothing is reported."""
GAIN = 0.06
"""Least gain in agreement, by putting depth right, that shows it to be off …"""
AGREES = 0.5
"""… and least agreement afterwards."""
SURELY = 0.7
"""Least agreement after a change of scale: something flat in front of the objects could look like one."""
SHIFT_PX = 3
"""Least shift that is more than noise of poses and edges [px]."""
SCALE = 0.015
"""Least change of scale that is more than noise of the sensor …"""
SURE_SCALE = 0.04
"""… and least one that is a reason to doubt the unit, as sensors are off by 1 or 2 %."""


@dataclass(frozen=True)
class Registration:
    """Change that lays the observed depth on the true one."""

    shift_px: tuple[int, int]
    """(right, down): where the depth of a pixel is found, relative to it [px]."""
    scale: float
    """Observed z over true z."""
    agreement: float
    """Mean of max(0, 1 − |Δz| / 20 mm) over the measured pixels of the objects, as it is …"""
    best_agreement: float
    """… and after shift and scale are undone."""

    @property
    def is_off(self) -> bool:
        """Whether depth is shifted or scaled."""
        changed = max(map(abs, self.shift_px)) >= SHIFT_PX or abs(self.scale - 1) >= SCALE
        return changed and self.best_agreement > AGREES and self.best_agreement - self.agreement > GAIN

    def undone(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """The depth image (H, W) [m] put right; 0 where that leaves a pixel without any."""
        return displaced(depth_m, self.shift_px) / np.float32(self.scale)


def registration_of(observed_m: NDArray[np.floating], true_m: NDArray[np.floating]) -> Registration:
    """Shift and scale that bring an observed depth image (H, W) [m] onto the true depth of the objects in it.

    Args:
        observed_m: 0 where nothing was measured.
        true_m: 0 where there is no object whose pose is known.
    """
    v, u = np.nonzero(true_m > 0)
    if len(v) == 0:
        return Registration((0, 0), 1.0, 1.0, 1.0)
    step = 1 + len(v) // PIXELS
    v, u = v[::step], u[::step]
    padded = np.pad(np.asarray(observed_m, dtype=np.float64), REACH_PX)
    true = np.asarray(true_m, dtype=np.float64)[v, u]
    z = padded[v + REACH_PX, u + REACH_PX]
    as_it_is = _agreement(z, true)
    if np.count_nonzero(z) < MEASURED * len(v):
        return Registration((0, 0), 1.0, as_it_is, as_it_is)
    scale = float(np.median(z[z > 0] / true[z > 0]))
    scaled = _agreement(z / scale, true)
    if scaled > SURELY and abs(scale - 1) >= SCALE:
        return Registration((0, 0), scale, as_it_is, scaled)

    # Where something stands in front, a shift could only seem to help.
    free = ~((z > 0) & (z < true - TAU_M))
    if np.count_nonzero(free) < MEASURED * len(v):
        return Registration((0, 0), 1.0, as_it_is, as_it_is)
    v, u, true = v[free], u[free], true[free]

    def agreement(right: int, down: int) -> float:
        return _agreement(padded[v + down + REACH_PX, u + right + REACH_PX], true)

    before = agreement(0, 0)
    shift, best = (0, 0), before
    coarse = [(x, y) for x in range(-36, 37, 4) for y in range(-36, 37, 4)]
    for x, y in sorted(coarse, key=lambda s: s[0] ** 2 + s[1] ** 2):
        if (value := agreement(x, y)) > best + 1e-9:
            shift, best = (x, y), value
    x0, y0 = shift
    for x, y in ((x0 + i, y0 + j) for i in range(-3, 4) for j in range(-3, 4)):
        if (value := agreement(x, y)) > best + 1e-9:
            shift, best = (x, y), value
    return Registration(shift, 1.0, before, best)


def _agreement(z: NDArray[np.floating], true: NDArray[np.floating]) -> float:
    """Mean fit of observed to true depths (n,) [m] over those that were measured."""
    fit = np.clip(1 - np.abs(z - true) / TAU_M, 0, None)
    return float(fit[z > 0].sum() / max(np.count_nonzero(z), MEASURED * len(z), 1))


def depth_shift_doubts(problem: Problem) -> tuple[Doubt, ...]:
    """A doubt where depth lies beside the objects in their ground-truth poses, or is of another scale than they are."""
    camera, true_m = problem.observation.camera, np.zeros(problem.observation.camera.shape, np.float32)
    pinhole = (camera.fx, camera.fy, camera.cx, camera.cy)
    for target in problem.targets:
        if target.instance.T_cam_obj_gt is not None:
            draw_depth(writable(target.instance.T_cam_obj_gt), *mesh_of(target.model).arrays, *pinhole, true_m)
    drawn = true_m > 0
    if _agreement(problem.observation.depth_m[drawn], true_m[drawn]) > AGREES:
        return ()  # Depth that is off by less may as well be that of noisy poses.
    off = registration_of(problem.observation.depth_m, true_m)
    if not off.is_off:
        return ()
    if off.scale != 1:
        if abs(off.scale - 1) < SURE_SCALE:
            return ()
        return (
            Doubt(
                DoubtKind.DEPTH_SCALE,
                f"depth is {off.scale:.3g} times what ground truth says: check depth_scale in scene_camera.json",
                f"depth {times_words(1 / off.scale)}",
                numbers={"depth_times": 1 / off.scale},
                remedy=DataSettings(depth_times=1 / off.scale),
            ),
        )
    right, down = off.shift_px
    advice = "warp it into the colour camera, or check cx, cy of cam_K"
    return (
        displaced_depth(right, down, f"depth lies {where_px(right, down)} of where colour and masks are: {advice}"),
    )


def displaced_depth(right: int, down: int, text: str) -> Doubt:
    """The doubt that depth lies this far to the right and down of where it should [px]."""
    return Doubt(
        DoubtKind.DEPTH_SHIFT,
        text,
        f"depth {max(abs(right), abs(down))} px beside",
        numbers={"right_px": right, "down_px": down},
        remedy=DataSettings(depth_shift_px=(right, down)),
    )


def where_px(right: int, down: int) -> str:
    """A displacement [px] in words."""
    aside = f"{abs(right)} px to the {'right' if right > 0 else 'left'}"
    return f"{aside} and {abs(down)} px {'down' if down > 0 else 'up'}"
