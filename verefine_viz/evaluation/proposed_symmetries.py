"""Proposes symmetries of a model's mesh for ``models_info.json``, for a person to confirm.

A near-symmetry (docs/methods.md 1.11) is proposed if it moves nearly all of the surface by no more than the error of a
depth sensor (9.4). Each proposal says how much shape and colour change; colours may show what depth cannot, so a person
decides what counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, inverse, transform
from verefine_viz.core.model import TEXTURE, ObjectModel
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.evaluation.near_symmetry import NearSymmetry, OrientedPoints, near_symmetries, sampled

NOISE_M = 0.0015
"""Motion of a surface that depth cannot show: real depth is that far from true models."""
NEARLY_ALL = 0.98
"""Share of the surface that counts, as scanned meshes have stray vertices."""
N_POINTS = 2000
TIDY_DEG, TIDY_M = 1.0, 1e-4
"""Angle within which an axis is replaced by an axis of the frame, and step to which centres are rounded."""
STEPS_DEG = range(10, 181, 10)
"""Turns that represent all turns about a continuous axis."""


@dataclass(frozen=True, eq=False)
class ProposedSymmetry:
    """A turn, or all turns about an axis, after which the model has the same shape."""

    axis: Float
    """(3,) unit vector, object frame."""
    centre_m: Float
    """(3,) a point of the axis [m]."""
    angle_deg: float | None
    """Angle of the turn; None = any."""
    changes_mm: float
    """Largest distance of nearly all of the turned surface from the surface [mm]."""
    colors_differ: float | None
    """Mean difference of the colours after the turn, in [0, 1], the largest of all turns; None without colours."""

    @property
    def looks_alike(self) -> bool:
        """Whether colours do not show the turn, or there are none."""
        return self.colors_differ is None or self.colors_differ < TEXTURE

    def turned(self, angle_deg: float) -> Float:
        """The turn (4, 4) about the axis by an angle [m]."""
        R = axis_angle(self.axis, np.radians(angle_deg))
        return transform(R, self.centre_m - R @ self.centre_m)

    @property
    def turns(self) -> Float:
        """(n, 4, 4) the turn, or turns that represent all [m]."""
        return np.array([self.turned(deg) for deg in (STEPS_DEG if self.angle_deg is None else (self.angle_deg,))])

    def describe(self) -> str:
        """Describe how much changes: "every turn about z: its shape changes by at most 0.4 mm"."""
        which = "every turn" if self.angle_deg is None else f"a turn of {self.angle_deg:.0f}°"
        k = int(np.argmax(np.abs(self.axis)))
        about = "xyz"[k] if abs(self.axis[k]) == 1 else "({:.2f}, {:.2f}, {:.2f})".format(*self.axis.tolist())
        colours = "" if self.colors_differ is None else f", its colours by {self.colors_differ:.0%} in the mean"
        return f"{which} about {about}: its shape changes by at most {self.changes_mm:.1f} mm{colours}"


def proposed_symmetries(model: ObjectModel, progress: ProgressToken = NEVER_CANCELLED) -> tuple[ProposedSymmetry, ...]:
    """Symmetries to propose, continuous ones first. Takes about a second, as the near-symmetries do.

    Raises:
        Cancelled: through ``progress``.
    """
    near = [one for one in near_symmetries(model, progress=progress) if one.is_continuous or one.order is not None]
    if not near:
        return ()
    surface = OrientedPoints(*sampled(model), model.diameter_m)
    candidates = [_measured(model, surface, one) for one in near]
    return tuple(one for one in candidates if one.changes_mm * 1e-3 <= NOISE_M)


def symmetry_entry(confirmed: Sequence[ProposedSymmetry]) -> dict[str, Any]:
    """Symmetries of an object in the form of its entry of ``models_info.json``, in millimetres."""
    entry: dict[str, Any] = {}
    axes = [one for one in confirmed if one.angle_deg is None]
    if axes:
        entry["symmetries_continuous"] = [
            {"axis": one.axis.tolist(), "offset": (one.centre_m * 1e3).tolist()} for one in axes
        ]
    turns = np.array([one.turned(one.angle_deg) for one in confirmed if one.angle_deg is not None])
    if len(turns):
        turns[:, :3, 3] *= 1e3
        entry["symmetries_discrete"] = turns.reshape(-1, 16).tolist()
    return entry


def colors_differ(model: ObjectModel, S: Float) -> float | None:
    """Mean difference of a vertex' colour to that of the nearest one after a turn (4, 4) [m], in [0, 1]; None without
    colours.
    """
    if model.vertex_colors is None:
        return None
    nearest = KDTree(model.vertices).query(apply(S, model.vertices))[1]
    colors = model.vertex_colors / 255.0
    return float(np.abs(colors - colors[nearest]).mean())


def _measured(model: ObjectModel, surface: OrientedPoints, near: NearSymmetry) -> ProposedSymmetry:
    """The near-symmetry with its axis and centre rounded where that changes no more than depth shows, else as found."""
    angle_deg = None
    if not near.is_continuous:
        step_deg = 360.0 / (near.order or 1)
        angle_deg = step_deg * round(near.angle_deg / step_deg)
    axis, k = near.axis, int(np.argmax(np.abs(near.axis)))
    if abs(axis[k]) > math.cos(math.radians(TIDY_DEG)):
        axis = np.eye(3)[k] * (1.0 if near.is_continuous or angle_deg == 180 else np.sign(axis[k]))
    centre_m = np.round(near.centre_m / TIDY_M) * TIDY_M + 0.0  # Avoids -0.
    tidy = _with_changes(model, surface, ProposedSymmetry(axis, centre_m, angle_deg, 0.0, None))
    if tidy.changes_mm * 1e-3 <= NOISE_M:
        return tidy
    return _with_changes(model, surface, ProposedSymmetry(near.axis, near.centre_m, angle_deg, 0.0, None))


def _with_changes(model: ObjectModel, surface: OrientedPoints, one: ProposedSymmetry) -> ProposedSymmetry:
    turns = one.turns
    apart_m = surface.apart_m(np.array([*turns, *map(inverse, turns)]), N_POINTS)
    colours = [differ for T in turns if (differ := colors_differ(model, T)) is not None]
    changes_mm = 1e3 * float(np.quantile(apart_m, NEARLY_ALL, axis=1).max())
    return ProposedSymmetry(one.axis, one.centre_m, one.angle_deg, changes_mm, max(colours, default=None))
