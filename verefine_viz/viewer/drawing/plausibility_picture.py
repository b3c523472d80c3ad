"""The plausibility of a pose as a table, and as a drawing seen from above."""

from __future__ import annotations

from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.palette import RGB
from verefine_viz.viewer.drawing.markup import text
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import in_focus, without_model
from verefine_viz.viewer.text.plausibility_verdict import SHARE_HINT, plausibility_verdict

LIGHTS: dict[str, RGB] = {
    "green": (40, 180, 80),
    "amber": (217, 142, 4),
    "red": (220, 50, 47),
    "grey": (140, 140, 140),
}
LIGHT_MEANING = {
    "green": ("stable", "gap, overlap and balance are within tolerance"),
    "amber": ("marginal", "it balances or overlaps at the edge of the tolerance"),
    "red": ("impossible", "it floats, sinks into something, or would tip over"),
    "grey": ("not yet", "it sinks into an object whose turn is still to come"),
}
"""What a light says, in short and in full."""
_SIZE = 92


_WHEN = {"current": "Before", "accepted": "Accepted", "best": "Answer", "edited": "Edited"}


def plausibility_html(snapshot: Snapshot) -> str:
    """Plausibility before the simulation, of the accepted and of the edited pose; empty where it is not known."""
    support = snapshot.target.observation.support
    if not snapshot.plausible or support is None:
        return ""
    o = in_focus(snapshot)
    verdicts = {name: plausibility_verdict(p, o, snapshot.scene) for name, p in snapshot.plausible.items()}
    lights = "".join(
        f'<p style="border-left:9px solid rgb{LIGHTS[p.light]};padding-left:6px">{_WHEN[name]}: {text(p.sentence)}</p>'
        for name, p in verdicts.items()
        if name == "edited" or "edited" not in verdicts  # While a pose is edited its numbers have to stay in sight.
    )
    head = "".join(
        f'<th style="border-bottom:2px solid rgb{LIGHTS[p.light]}" title="{text(p.sentence)}">'
        f"{_WHEN[name].lower()}</th>"
        for name, p in verdicts.items()
    )
    facts = list(snapshot.plausible.values())
    rows = "".join(
        f'<tr title="{text(tip)}"><td>{name}</td>{"".join(f"<td>{text(say(p))}</td>" for p in facts)}</tr>'
        for name, tip, say in (
            ("gap mm", "distance to the nearest surface", lambda p: f"{p.gap_mm:.1f}"),
            ("overlap mm", "deepest penetration, and into what", _overlap),
            ("balance mm", "centre of mass to the edge of the support polygon; negative = outside: it tips over",
             lambda p: "no support" if np.isneginf(p.margin_mm) else f"{p.margin_mm:.1f}"),
            ("stable", "whether friction at the contacts can hold it still; contacts deep inside a surface cannot tell",
             lambda p: {None: "unknown", True: "yes", False: "no"}[p.is_stable]),
        )
    )  # fmt: skip
    table = f"<table><tr><th></th>{head}</tr>{rows}</table>"
    share = f"{support.inlier_share:.0%} of the background lies on the support plane."
    return (
        f'{lights}<div style="display:flex;gap:8px">{table}{_drawing(snapshot)}</div>'
        f'<p class="dim" title="{text(SHARE_HINT)}">{share}</p>'
    )


def _overlap(plausibility: Any) -> str:
    if plausibility.penetrates is None:
        return "none"
    return f"{plausibility.penetration_mm:.1f} {without_model(plausibility.penetrates) or 'object'}"


def drawn_stage(snapshot: Snapshot) -> str | None:
    """The stage whose support is drawn: edited, or else accepted, unless the pose before could not stand."""
    if "edited" in snapshot.plausible:
        return "edited"
    before = snapshot.plausible.get("current")
    if before is not None and (not before.is_stable or "accepted" not in snapshot.plausible):
        return "current"
    return next((name for name in ("accepted", "best") if name in snapshot.plausible), None)


def _drawing(snapshot: Snapshot) -> str:
    """Object, support polygon and centre of mass from above, as an SVG."""
    support, name = snapshot.target.observation.support, drawn_stage(snapshot)
    assert support is not None
    if name is None:
        return ""
    plausibility, T_cam_obj = snapshot.plausible[name], snapshot.poses[name].T_cam_obj
    seen = apply(support.T_world_cam @ T_cam_obj, snapshot.target.model.points[::8])[:, :2]
    polygon = apply(support.T_world_cam, plausibility.polygon_cam)[:, :2]
    centre = apply(support.T_world_cam, plausibility.com_on_plane_cam[None])[0, :2]
    everything = np.concatenate([seen, polygon, centre[None]])
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale = (_SIZE - 8) / max(float((high - low).max()), 1e-6)

    def place(xy: Float) -> Float:
        flat = (np.atleast_2d(xy) - (low + high) / 2) * scale
        return np.column_stack([flat[:, 0] + _SIZE / 2, _SIZE / 2 - flat[:, 1]])

    dots = "".join(f'<circle cx="{x:.0f}" cy="{y:.0f}" r="1"/>' for x, y in place(seen))
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in place(polygon)) if len(polygon) else ""
    x, y = place(centre)[0]
    color = LIGHTS[plausibility_verdict(plausibility, in_focus(snapshot), snapshot.scene).light]
    title = f"{_WHEN[name].lower()}, from above: object (dots), support polygon, centre of mass (cross)"
    shrinks = f"flex:0 1 {_SIZE}px;min-width:44px;height:{_SIZE}px"
    return (
        f'<svg viewBox="0 0 {_SIZE} {_SIZE}" style="{shrinks}"><title>{text(title)}</title>'
        f'<g fill="currentColor" opacity="0.25">{dots}</g>'
        f'<polygon points="{corners}" fill="rgb{color}" fill-opacity="0.25" stroke="rgb{color}" stroke-width="2"/>'
        f'<path d="M{x - 5:.1f} {y:.1f}h10M{x:.1f} {y - 5:.1f}v10" stroke="currentColor" stroke-width="2"/></svg>'
    )
