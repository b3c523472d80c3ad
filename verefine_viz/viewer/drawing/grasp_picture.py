"""A grasp over time: its stages, the forces of the fingers and the height of the object; and one moment in numbers."""

from __future__ import annotations

from itertools import groupby

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import RGB, STAGE_COLORS
from verefine_viz.viewer.drawing.markup import NONE, Row, cut, small, table, text
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.grasp_trials import ShownGrasp

TOUCHED_PX = 72
"""Of the names of what is touched, which may be long."""
WIDTH_PX, HEIGHT_PX, STRIP_PX = 300, 64, 14
SHADES = ("#3a3f47", "#4a505a")
LEAST_MM, LEAST_N = 20.0, 5.0
"""What a curve's full height is at least: an object that comes to rest by a tenth of a millimetre does not rise."""
HEIGHT_COLOR, FORCE_COLOR = STAGE_COLORS["best"], (255, 190, 90)


def grasp_picture(shown: ShownGrasp) -> str:
    """Stages as a strip, below it the forces and the height; a line where the moment is. Empty without a grasp."""
    path = shown.attempt.path
    if path is None:
        return ""
    n = path.n_moments
    xs = np.linspace(0, WIDTH_PX, n)
    strip, start = [], 0
    for k, (stage, moments) in enumerate(groupby(path.stages)):
        length = len(list(moments))
        x, width = WIDTH_PX * start / n, WIDTH_PX * length / n
        name = (
            f'<text x="{x + width / 2:.1f}" y="10" text-anchor="middle" font-size="9" fill="#ddd">{text(stage)}</text>'
        )
        strip.append(
            f'<rect x="{x:.1f}" y="0" width="{width:.1f}" height="{STRIP_PX}" fill="{SHADES[k % 2]}"/>'
            + name * (width > 5 * len(stage))
        )
        start += length
    rise_mm, force_n = _rise_mm(shown), path.forces_n.mean(axis=1)
    lines = _line(xs, rise_mm, LEAST_MM, HEIGHT_COLOR) + _line(xs, force_n, LEAST_N, FORCE_COLOR)
    x = float(xs[shown.moment])
    cursor = f'<line x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{HEIGHT_PX}" stroke="#fff"/>'
    return (
        f'<svg viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}" style="width:100%;display:block" aria-label="grasp over time">'
        f"{''.join(strip)}{lines}{cursor}</svg>"
    )


def moment_table(shown: ShownGrasp, snapshot: Snapshot) -> str:
    """The moment that is shown, in numbers."""
    path = shown.attempt.path
    if path is None:
        blocked = "No grasp was carried out: the gripper would meet what the sensor saw, or the plane."
        return small(blocked if len(shown.attempt.is_free) else "No grasp exists: wider than the gripper opens.")
    k = shown.moment
    left, right = path.forces_n[k]
    cells = [
        path.stages[k],
        f"{max(path.gaps_m[k], 0.0) * 1e3:.0f}",
        f'<span style="color:rgb{FORCE_COLOR}">{left:.0f} / {right:.0f}</span>',
        f'<span style="color:rgb{HEIGHT_COLOR}">{round(_rise_mm(shown)[k]) + 0:d}</span>',
        _touched(shown, snapshot),
    ]
    head = [
        ("stage", "of the grasp"),
        ("gap mm", "between the fingers"),
        ("force N", "of the fingers on the object, left / right"),
        ("rise mm", "of the object since the start"),
        ("touches", "what the gripper presses on"),
    ]
    return table(head, [Row(cells)])


def _touched(shown: ShownGrasp, snapshot: Snapshot) -> str:
    path = shown.attempt.path
    assert path is not None
    labels = {o.instance_id: o.label for o in snapshot.scene.objects}
    names = {"plane" if c.instance_id is None else labels[c.instance_id] for c in path.contacts[shown.moment]}
    return cut(", ".join(sorted(names)) or NONE, TOUCHED_PX)


def _rise_mm(shown: ShownGrasp) -> Float:
    """(N,) how much higher the object is than at the start."""
    path = shown.attempt.path
    assert path is not None
    z_m = path.Ts_world_obj[shown.attempt.instance_id][:, 2, 3]
    return 1e3 * (z_m - z_m[0])


def _line(xs: Float, values: Float, least: float, color: RGB) -> str:
    """A curve in what is left below the strip, from 0 to its highest value, or to ``least``."""
    highest = max(float(values.max()), least)
    ys = HEIGHT_PX - 2 - (HEIGHT_PX - STRIP_PX - 6) * np.clip(values / highest, 0, 1)
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(xs, ys, strict=True))
    return f'<polyline points="{points}" fill="none" stroke="rgb{color}" stroke-width="1.5"/>'
