"""Score maps on the page: which part of the image, with which labels, as PNGs; all of them on a sheet to save."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont

from verefine_viz.core.palette import CLASS_COLORS, Image, Scale, depth_scale
from verefine_viz.core.problem import Target
from verefine_viz.core.scores import COLOUR_MAPS, MAP_NAMES, MapName, ScoreMaps
from verefine_viz.pictures.map_images import MapImages, scales_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import method_name

LABELS: dict[MapName, tuple[str, str]] = {
    "observed": ("observed", "depth that the sensor measured"),
    "rendered": ("rendered", "depth of the model under this pose"),
    "difference": ("Δdepth", "observed − rendered: red = the sensor saw past the model, blue = something before it"),
    "angle": ("angle", "between observed and rendered surface normal"),
    "f_d": ("f_d", "depth fit of Eq. 1: 1 = same depth, 0 = off by τ or more"),
    "f_n": ("f_n", "normal fit of Eq. 1: 1 = same direction, 0 = beyond the cut-off angle"),
    "classes": ("classes", "why each pixel counts as it does"),
    "observed_colour": ("image colour", "the camera's image as the colour term sees it, smoothed"),
    "rendered_colour": ("model colour", "the model's colours under this pose, without light"),
    "correlation": ("correlation", "what each explained pixel adds to f_c: blue = for this pose, red = against it"),
}
ASPECT = 1.0
"""Width / height of a map on the page."""


@dataclass(frozen=True)
class Crop:
    """Columns u0 … u1 − 1 and rows v0 … v1 − 1 of an image; may reach beyond its border."""

    u0: int
    v0: int
    u1: int
    v1: int

    @property
    def width(self) -> int:
        return self.u1 - self.u0

    @property
    def height(self) -> int:
        return self.v1 - self.v0

    def of(self, image: NDArray[Any], fill: float = 0) -> NDArray[Any]:
        """The cut-out of an image (H, W, …), ``fill`` where the crop reaches beyond the image."""
        h, w = image.shape[:2]
        out = np.full((self.height, self.width, *image.shape[2:]), fill, image.dtype)
        u0, v0, u1, v1 = max(self.u0, 0), max(self.v0, 0), min(self.u1, w), min(self.v1, h)
        if u1 > u0 and v1 > v0:
            out[v0 - self.v0 : v1 - self.v0, u0 - self.u0 : u1 - self.u0] = image[v0:v1, u0:u1]
        return out

    def images(self, maps: ScoreMaps, target: Target, tau_m: float) -> MapImages:
        """The cut-out of the maps of a pose (H, W)."""
        without_value = {"depth_difference_m": np.nan, "angle_rad": np.nan, "correlation": np.nan}
        there = {name: image for name, image in vars(maps).items() if image is not None}
        part = ScoreMaps(**{name: self.of(image, without_value.get(name, 0)) for name, image in there.items()})
        return MapImages(part, self.of(target.observation.depth_m), scales_for(target, tau_m))


def map_names(maps: Sequence[ScoreMaps | None]) -> tuple[MapName, ...]:
    """The maps that have values: those of the colour term only where it counts."""
    has_colour = any(one is not None and one.correlation is not None for one in maps)
    return tuple(name for name in MAP_NAMES if has_colour or name not in COLOUR_MAPS)


def bounds(mask: NDArray[np.bool_]) -> Crop:
    """The smallest part of the image that holds ``mask``; of no size where that is empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return Crop(0, 0, 0, 0)
    return Crop(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)


def crop_around(mask: NDArray[np.bool_], aspect: float, margin: float = 0.25, step: int = 16) -> Crop:
    """The part of the image to show for an object: around ``mask``, of the given width / height.

    Sizes go in steps, so that the picture does not jitter from iteration to iteration. An empty mask gives all of it.
    """
    own = bounds(mask)
    if own.height == 0:
        own, margin = Crop(0, 0, mask.shape[1], mask.shape[0]), 0.0
    height, width = float(own.height), float(own.width)
    moved = step // 2 + 3  # The middle is rounded below: a small object must still be inside.
    height, width = max(height * (1 + 2 * margin), height + moved), max(width * (1 + 2 * margin), width + moved)
    height = max(height, width / aspect, step)
    height = int(np.ceil(height / step) * step)
    width = round(height * aspect)
    v, u = (own.v0 + own.v1) // 2, (own.u0 + own.u1) // 2
    half = step // 2
    v, u = round(v / half) * half, round(u / half) * half
    return Crop(u - width // 2, v - height // 2, u - width // 2 + width, v - height // 2 + height)


def shared_crop(view: Snapshot) -> Crop:
    """The part of the image that holds the mask and both renderings."""
    relevant = view.map_target.instance.mask.copy()
    for side in (view.a, view.b):
        if side is not None and side.maps is not None:
            relevant |= side.maps.rendered_m > 0
    return crop_around(relevant, ASPECT)


def scales_for(target: Target, tau_m: float) -> dict[MapName, Scale]:
    """The scales of the maps of one object in one frame, the same for every pose; classes and colours have none."""
    depth = target.observation.depth_m[target.instance.mask]
    depth = depth[depth > 0]
    centre = float(np.median(depth)) if len(depth) else 1.0
    half = max(target.model.diameter_m, 0.05)
    return scales_of(depth_scale(round(centre - half, 2), round(centre + half, 2)), tau_m)


def map_over(photo: Image, name: MapName, maps: ScoreMaps, target: Target, tau_m: float) -> Image:
    """One map where it belongs to the score, a photo (H, W, 3) elsewhere."""
    image, part = photo.copy(), bounds(maps.classes > 0)
    shown = part.images(maps, target, tau_m)
    np.copyto(image[part.v0 : part.v1, part.u0 : part.u1], shown.rgb(name), where=shown.maps.classes[..., None] > 0)
    return image


def png(image: Image) -> bytes:
    """An image (H, W, 3) as PNG."""
    out = io.BytesIO()
    PilImage.fromarray(image).save(out, format="PNG", compress_level=1)
    return out.getvalue()


def indexed_png(image: NDArray[np.uint8], palette: bytes) -> bytes:
    """A PNG of (H, W) indices into an RGB ``palette`` (768 bytes)."""
    picture, out = PilImage.fromarray(image), io.BytesIO()
    picture.putpalette(palette)
    # Higher levels take longer and gain next to nothing.
    picture.save(out, "png", compress_level=4)
    return out.getvalue()


def data_uri(content: bytes) -> str:
    """A PNG as something an ``<img>`` can show without a further request."""
    return "data:image/png;base64," + base64.b64encode(content).decode("ascii")


# All score maps of both stages as one picture, with names and colour bars, to be saved.

_TILE_W, _TILE_H, _LEFT, _TITLE, _HEAD, _BAR, _GAP = 240, 192, 150, 30, 34, 46, 8
_TOP = _TITLE + _HEAD


def maps_sheet(view: Snapshot) -> Image:
    """(H, W, 3) RGB: what it is of, then a row per stage, a column per map, cut to the object."""
    sides = [s for s in (view.a, view.b) if s is not None and s.maps is not None]
    names = map_names([side.maps for side in sides])
    width = _LEFT + len(names) * (_TILE_W + _GAP)
    height = _TOP + max(len(sides), 1) * (_TILE_H + _GAP) + _BAR
    sheet = PilImage.new("RGB", (width, height), (250, 250, 250))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    draw.text((8, 8), sheet_title(view), (20, 20, 20), font=font)
    crop, tau_m = shared_crop(view), view.session.score.tau_m
    scales = scales_for(view.map_target, tau_m)
    for row, side in enumerate(sides):
        assert side.maps is not None
        top = _TOP + row * (_TILE_H + _GAP)
        score = f"\nscore {side.pose.score.score:.3f}" if side.pose.score else ""
        draw.text((8, top + 8), f"{side.pose.label}{score}", (20, 20, 20), font=font)
        images = crop.images(side.maps, view.map_target, tau_m)
        for column, name in enumerate(names):
            tile = PilImage.fromarray(images.rgb(name)).resize((_TILE_W, _TILE_H), PilImage.Resampling.NEAREST)
            sheet.paste(tile, (_LEFT + column * (_TILE_W + _GAP), top))
    if not sides:
        draw.text((8, _TOP + 8), "no pose to show here", (20, 20, 20), font=font)
    bottom = height - _BAR
    for column, name in enumerate(names):
        left = _LEFT + column * (_TILE_W + _GAP)
        draw.text((left, _TITLE + 8), _heading(name), (20, 20, 20), font=font)
        scale = scales.get(name)
        if name == "classes":
            _legend(draw, left, bottom)
        if scale is None:
            continue
        ramp = np.linspace(scale.low, scale.high, _TILE_W)
        bar = np.repeat(scale.colors(ramp)[None], 10, axis=0)
        sheet.paste(PilImage.fromarray(bar), (left, bottom))
        draw.text((left, bottom + 14), scale.ticks[0], (20, 20, 20), font=font)
        draw.text((left + _TILE_W, bottom + 14), scale.ticks[2], (20, 20, 20), font=font, anchor="ra")
    return np.asarray(sheet)


def sheet_title(view: Snapshot) -> str:
    """Of which object, frame and moment of a run the maps are."""
    whose = "all objects" if view.is_whole_scene else view.scene.object(view.target.instance.instance_id).label
    when = f"answer after {view.cursor} iterations" if view.is_answer else f"iteration {view.cursor}"
    return f"{whose}, frame {view.frame}, {method_name(view.session.method.name)}, {when}"


def _heading(name: MapName) -> str:
    """A map's label in letters that the picture's typeface has."""
    return LABELS[name][0].replace("Δ", "delta ")


def _legend(draw: ImageDraw.ImageDraw, left: int, top: int) -> None:
    font = ImageFont.load_default(11)
    for k, (name, color) in enumerate(CLASS_COLORS.items()):
        x, y = left + (k % 3) * 80, top + (k // 3) * 16
        draw.rectangle((x, y + 2, x + 9, y + 11), fill=color)
        draw.text((x + 13, y), name, (20, 20, 20), font=font)
