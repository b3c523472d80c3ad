"""A model's near-symmetries: a small picture of it with their axes, and a line for each kind of turn."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.palette import STAGE_COLORS, Image
from verefine_viz.core.problem import Placed
from verefine_viz.evaluation.near_symmetry import NearSymmetry
from verefine_viz.rendering.rendered_scene import render_scene
from verefine_viz.viewer.drawing.markup import small
from verefine_viz.viewer.drawing.score_maps import data_uri, png

SIZE_PX, FINER = 108, 2
"""Width and height of the picture, and how many times finer it is drawn."""
AZIMUTH_RAD, ELEVATION_RAD = np.radians(-55.0), np.radians(25.0)
"""From where the model is seen, in its own frame with z up."""
FAR, REACH = 8.0, 0.62
"""Distance of the camera, and how far an axis reaches from the middle [diameters]."""
BACKGROUND = 24
AXIS_COLOR = STAGE_COLORS["flipped"]
SAME_AXIS = 0.99
HINT = (
    "Mean distance between the model's surface and the turned one. Depth can hardly tell poses apart that differ by "
    "such a turn; where colour counts, hypotheses.flips lets them compete."
)


def near_symmetries_html(model: ObjectModel, symmetries: Sequence[NearSymmetry]) -> str:
    """The picture and the lines; a sentence where there is none."""
    if not symmetries:
        return small("No turn leaves its shape nearly the same.", HINT)
    axes = by_axis(symmetries)
    lines = "".join(f"<div>{line}</div>" for line in turns_in_words(axes))
    return (
        f'<div style="display:flex;gap:8px;align-items:center">{_picture(model, axes)}'
        f"<div>{small('Its shape nearly looks the same, turned by', HINT)}{lines}</div></div>"
    )


def by_axis(symmetries: Sequence[NearSymmetry]) -> list[list[NearSymmetry]]:
    """Those about the same axis together, the least turn of each axis first."""
    axes: list[list[NearSymmetry]] = []
    for one in sorted(symmetries, key=lambda s: (not s.is_continuous, s.angle_deg)):
        same = next((axis for axis in axes if abs(axis[0].axis @ one.axis) > SAME_AXIS), None)
        if same is None:
            axes.append([one])
        else:
            same.append(one)
    return axes


def turns_in_words(axes: Sequence[Sequence[NearSymmetry]]) -> list[str]:
    """As in: "180° about 3 axes: 1.4 to 1.8 mm apart"."""
    alike: dict[str, list[float]] = {}
    for axis in axes:
        alike.setdefault(_angle(axis[0]), []).append(1e3 * max(one.distance_m for one in axis))
    lines: list[str] = []
    for angle, mm in alike.items():
        about = "" if len(mm) == 1 else f" about {len(mm)} axes"
        low, high = f"{min(mm):.1f}", f"{max(mm):.1f}"
        lines.append(f"{angle}{about}: {high if low == high else f'{low} to {high}'} mm apart")
    return lines


def _angle(one: NearSymmetry) -> str:
    return "any angle" if one.is_continuous else f"{one.angle_deg:.0f}°"


def _picture(model: ObjectModel, axes: Sequence[Sequence[NearSymmetry]]) -> str:
    image, camera, T_cam_obj = _seen(model)
    middle_cam = apply(T_cam_obj, model.middle_m[None])[0]
    lines = ""
    for axis in axes:
        one = axis[0]
        along = T_cam_obj[:3, :3] @ one.axis
        on_axis = apply(T_cam_obj, one.centre_m[None])[0]
        on_axis += ((middle_cam - on_axis) @ along) * along
        ends = on_axis + np.outer([-REACH, REACH], along) * model.diameter_m
        (x0, y0), (x1, y1) = camera.project(ends).tolist()
        lines += f'<line x1="{x0:.0f}" y1="{y0:.0f}" x2="{x1:.0f}" y2="{y1:.0f}"/>'
    side = SIZE_PX * FINER
    return (
        f'<svg viewBox="0 0 {side} {side}" width="{SIZE_PX}" height="{SIZE_PX}" role="img" style="flex:none" '
        f'aria-label="axes of near-symmetries"><image href="{data_uri(png(image))}" width="{side}" height="{side}"/>'
        f'<g stroke="rgb{AXIS_COLOR}" stroke-width="3" stroke-dasharray="9 5">{lines}</g></svg>'
    )


@lru_cache(maxsize=64)
def _seen(model: ObjectModel) -> tuple[Image, Camera, Float]:
    """The model's picture, the camera and T_cam_obj (4, 4)."""
    towards = np.array(
        [
            np.cos(ELEVATION_RAD) * np.cos(AZIMUTH_RAD),
            np.cos(ELEVATION_RAD) * np.sin(AZIMUTH_RAD),
            np.sin(ELEVATION_RAD),
        ]
    )
    right = np.array([-np.sin(AZIMUTH_RAD), np.cos(AZIMUTH_RAD), 0.0])
    R = np.array([right, np.cross(-towards, right), -towards])
    away_m, side = FAR * model.diameter_m, SIZE_PX * FINER
    T = transform(R, np.array([0.0, 0.0, away_m]) - R @ model.middle_m)
    focal_px = 0.95 * side * FAR / (2 * REACH)
    camera = Camera(np.array([[focal_px, 0, side / 2], [0, focal_px, side / 2], [0, 0, 1]]), side, side)
    drawn = render_scene([Placed(0, model, T)], camera)
    return np.where(drawn.labels[..., None] < 0, np.uint8(BACKGROUND), drawn.rgb), camera, T
