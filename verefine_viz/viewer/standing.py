"""Whether a pose could stand like that, in words and as a drawing seen from above."""

from __future__ import annotations

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.viewer.markup import text
from verefine_viz.viewer.view import View

LIGHTS = {"green": (40, 180, 80), "amber": (217, 142, 4), "red": (220, 50, 47)}
_SIZE = 92


def standing_html(view: View) -> str:
    """Plausibility of the kept pose; empty where it is not known."""
    found = view.plausible
    support = view.target.observation.support
    if found is None or support is None:
        return ""
    color = LIGHTS[found.light]
    margin = "nothing carries it" if np.isneginf(found.margin_mm) else f"{found.margin_mm:.1f} mm"
    partner = "the table" if found.penetrates == -1 else "a neighbour"
    sunk = "none" if found.penetrates is None else f"{found.penetration_mm:.1f} mm into {partner}"
    facts = (
        ("gap", f"{found.gap_mm:.1f} mm", "distance to the nearest surface below or beside it"),
        ("penetration", sunk, "deepest overlap"),
        ("balance", margin, "centre of mass to the edge of the support polygon; negative = outside, it tips over"),
        ("stable", "yes" if found.is_stable else "no", "whether friction at the contacts can hold it still"),
        ("plane", f"{support.inlier_share:.0%} of background", "share of the background's depth on the support plane"),
    )
    rows = "".join(f'<tr title="{text(tip)}"><td>{name}</td><td>{text(value)}</td></tr>' for name, value, tip in facts)
    pose = "accepted" if "accepted" in view.poses else "current"
    light = f'<p style="border-left:9px solid rgb{color};padding-left:6px">{text(pose.capitalize())} pose: '
    light += f"{text(found.sentence)}</p>"
    return f'{light}<div style="display:flex;gap:8px"><table>{rows}</table>{_drawing(view)}</div>'


def polygon_and_centre(view: View) -> tuple[Float, Float]:
    """The support polygon (m, 2) and the centre of mass (2,) from above, in the world frame [m]."""
    assert view.plausible is not None
    support = view.target.observation.support
    assert support is not None
    polygon = apply(support.T_world_cam, view.plausible.polygon_cam)[:, :2]
    return polygon, apply(support.T_world_cam, view.plausible.com_on_plane_cam[None])[0, :2]


def _drawing(view: View) -> str:
    """Object outline points, support polygon and centre of mass from above, as an SVG."""
    support = view.target.observation.support
    assert support is not None
    assert view.plausible is not None
    pose = view.poses.get("accepted") or view.poses["current"]
    seen = apply(support.T_world_cam @ pose.T_cam_obj, view.target.model.points[::8])[:, :2]
    polygon, centre = polygon_and_centre(view)
    everything = np.concatenate([seen, polygon, centre[None]])
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale = (_SIZE - 8) / max(float((high - low).max()), 1e-6)

    def place(xy: Float) -> Float:
        flat = (np.atleast_2d(xy) - (low + high) / 2) * scale
        return np.column_stack([flat[:, 0] + _SIZE / 2, _SIZE / 2 - flat[:, 1]])

    dots = "".join(f'<circle cx="{x:.0f}" cy="{y:.0f}" r="1"/>' for x, y in place(seen))
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in place(polygon)) if len(polygon) else ""
    x, y = place(centre)[0]
    color = LIGHTS[view.plausible.light]
    return (
        f'<svg width="{_SIZE}" height="{_SIZE}" style="flex:none"><title>from above: object (dots), support polygon, '
        f'centre of mass (cross)</title><g fill="currentColor" opacity="0.25">{dots}</g>'
        f'<polygon points="{corners}" fill="rgb{color}" fill-opacity="0.25" stroke="rgb{color}" stroke-width="2"/>'
        f'<path d="M{x - 5:.1f} {y:.1f}h10M{x:.1f} {y - 5:.1f}v10" stroke="currentColor" stroke-width="2"/></svg>'
    )
