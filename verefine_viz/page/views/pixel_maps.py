"""The score of a pose, or of several together, pixel by pixel: raw arrays over a part of the image."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.accuracy import PoseErrors
from verefine_viz.core.arrays import Mask
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Target
from verefine_viz.core.scores import PIXEL_CLASSES, PoseScore, ScoreMaps
from verefine_viz.page.answers_to_wants import MapsAnswer, MapScale, ScoreNumbers, StoredArray
from verefine_viz.page.frame_messages import Box
from verefine_viz.page.protocol import pose_matrix

if TYPE_CHECKING:
    from verefine_viz.page.blobs import Blobs
    from verefine_viz.page.protocol import MapsWanted
    from verefine_viz.page.workspace import Workspace

MARGIN_PX = 12
"""Margin around the pixels with numbers."""
ALIGNED = 8
"""Offsets of arrays in their blob are multiples of it."""
LEAST_DEPTH_M = 0.05
"""Least half range of the depth scale."""


def maps(space: Workspace, want: MapsWanted, blobs: Blobs) -> MapsAnswer:
    """The answer to a want of maps, as docs/page.md describes it.

    Raises:
        InputError: there is no such branch or object, no pose is given, or the score is not made of pixels.
    """
    evaluator = space.branch(want.branch).evaluator_of(want.k)
    if want.obj is None:
        targets = [space.problem.target(obj) for obj, _ in want.poses]
        Ts = np.array([T for _, T in want.poses], float).reshape(-1, 4, 4)
        if len(targets) == 0:
            raise InputError("maps of no pose were asked for")
        score = evaluator.scene_score(targets, Ts)
        pixels, errors = evaluator.scene_maps(targets, Ts), None
    else:
        if want.T is None:
            raise InputError("maps of no pose were asked for")
        targets, T_cam_obj = [space.problem.target(want.obj)], pose_matrix(want.T)
        score, pixels = evaluator.score(targets[0], T_cam_obj), evaluator.maps(targets[0], T_cam_obj)
        errors = evaluator.errors(targets[0], T_cam_obj)
    if pixels is None:
        raise InputError(f"{evaluator.verifier.settings.verifier} gives a score, and no maps of it.")
    region = region_of(pixels, targets)
    key, arrays = packed(cut(pixels, region), blobs)
    scale = MapScale(depth_range(targets), 1e3 * evaluator.verifier.settings.tau_m, score.colour_weight)
    return MapsAnswer(region, score_numbers(score, errors), scale, key, arrays)


def score_numbers(score: PoseScore, errors: PoseErrors | None) -> ScoreNumbers:
    """A score with its parts, the pixels of each class, and the errors of the pose where they are known."""
    return ScoreNumbers(
        score=score.score,
        depth_fit=score.depth_fit,
        normal_fit=score.normal_fit,
        colour_fit=score.colour_fit,
        plausibility=score.plausibility,
        n=score.n_pixels,
        counts=dict(zip(PIXEL_CLASSES, score.counts, strict=True)),
        err=None if errors is None else errors.add_s_mm,
        deg=None if errors is None else errors.rotation_deg,
        mm=None if errors is None else errors.translation_mm,
    )


def region_of(pixels: ScoreMaps, targets: list[Target]) -> Box:
    """[u0, v0, width, height] around the masks, the rendered and the scored pixels; within the image."""
    shown: Mask = (pixels.rendered_m > 0) | pixels.counted
    for target in targets:
        shown |= target.instance.mask
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    height, width = shown.shape
    if len(rows) == 0:
        return 0, 0, width, height
    u0, v0 = max(int(columns[0]) - MARGIN_PX, 0), max(int(rows[0]) - MARGIN_PX, 0)
    u1, v1 = min(int(columns[-1]) + 1 + MARGIN_PX, width), min(int(rows[-1]) + 1 + MARGIN_PX, height)
    return u0, v0, u1 - u0, v1 - v0


def cut(pixels: ScoreMaps, region: Box) -> dict[str, NDArray[Any]]:
    """The arrays of a region by name, (h, w) or (h, w, 3); those of colour only where it counts."""
    u0, v0, width, height = region
    named = {
        "rendered": pixels.rendered_m,
        "angle": pixels.angle_rad,
        "f_d": pixels.f_d,
        "f_n": pixels.f_n,
        "classes": pixels.classes,
        "counted": pixels.counted.view(np.uint8),
        "correlation": pixels.correlation,
        "rendered_rgb": pixels.rendered_rgb,
    }
    there = {name: image for name, image in named.items() if image is not None}
    return {name: image[v0 : v0 + height, u0 : u0 + width] for name, image in there.items()}


def packed(images: dict[str, NDArray[Any]], blobs: Blobs) -> tuple[str, list[StoredArray]]:
    """Key of one blob with all arrays, and the position of each in it."""
    content, table = bytearray(), list[StoredArray]()
    for name, image in images.items():
        kind = image.dtype.newbyteorder("<")
        table.append(StoredArray(name, image.dtype.name, len(content), image.size))
        content += np.ascontiguousarray(image, kind).tobytes()
        content += bytes(-len(content) % ALIGNED)
    return blobs.put(bytes(content)), table


def depth_range(targets: list[Target]) -> tuple[float, float]:
    """[nearest, farthest] of the depth scale [m]: one for all poses of these objects."""
    mask: Mask = np.logical_or.reduce([target.instance.mask for target in targets])
    depth_m = targets[0].observation.depth_m[mask]
    depth_m = depth_m[depth_m > 0]
    largest = max(target.model.diameter_m for target in targets)
    low, high = np.percentile(depth_m, (5, 95)) if len(depth_m) else (1.0, 1.0)
    around = max(largest / 2, LEAST_DEPTH_M, float(high - low) / 2)
    return round(float(low + high) / 2 - around, 2), round(float(low + high) / 2 + around, 2)
