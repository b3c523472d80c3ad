"""The static part of a recording, logged once: the frame, its support plane, and a mesh for everything drawn later.

Stages of an object move by their transforms alone, so their meshes are made once for all frames that show them.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.decimation import decimated
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import TILT_SHOWN_DEG, Observation, Support
from verefine_viz.core.palette import ARM_COLORS, OBJECT_COLORS, RGB, STAGE_COLORS
from verefine_viz.core.problem import Problem, Target
from verefine_viz.pictures.skin import skin_of
from verefine_viz.pictures.surroundings_meshes import (
    SOLID_COLOR,
    SURFACE_COLOR,
    DrawnSurroundings,
    drawn_surroundings,
)
from verefine_viz.recording import entities
from verefine_viz.recording.layout import Layout, world_from_camera
from verefine_viz.recording.recording_file import RecordingFile

CLOUD_POINTS, CLOUD_POINTS_WITH_PICTURES = 3_000, 20_000
"""About as many pixels of the objects are drawn as points; the rest of the frame gets far fewer."""
AROUND = 3
"""Around the objects, the step between drawn pixels is this many times that on the objects."""
SPARSE_PX = 12
"""Step between drawn pixels far from the objects."""
PLANE_COLOR, GRAVITY_COLOR, NORMAL_COLOR = 0x5A8CA02D, 0x78BEDCFF, 0x78A5D7FF
SURFACE_ALPHA, SOLID_ALPHA = 90, 150
DRAWN_FACES, DRAWN_FACES_IN_SCENE = 1200, 500
GHOST_FACES = 300
STAGE_ALPHA = {"current": 110, "simulated": 150, "mixed": 90, "refined": 170, "best": 230, "placed": 200}
STAGE_ALPHA |= {"flipped": 170, "incumbent": 255}
TEXTURED, TEXTURE_PX = ("best", "incumbent"), 128
"""Stages that show an object's texture, if it has one, and the size of its image: it is stored uncompressed."""
GHOST_ALPHA = 35
GROUND_TRUTH_ALPHA = 60


def log_background(file: RecordingFile, problem: Problem, layout: Layout, pictures: bool) -> None:
    """Everything static of a frame; transforms of the stages follow with the iterations.

    Args:
        file: where to.
        problem: the frame.
        layout: its layout.
        pictures: also colour, depth and masks as images, and a denser cloud.
    """
    observation = problem.observation
    T_world_cam = world_from_camera(observation)
    file.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    file.log(entities.SCENE, _transform(T_world_cam))
    if observation.support:
        _log_support(file, observation.support, layout)
    for k, target in enumerate(problem.targets):
        own = OBJECT_COLORS[k % len(OBJECT_COLORS)] if len(problem.targets) > 1 else None
        _log_object(file, target, layout, own)
    near_m = _depth_m(T_world_cam, layout.center_world)
    camera = observation.camera
    pinhole = rr.Pinhole(
        image_from_camera=camera.K,
        resolution=[camera.width, camera.height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.12 * near_m,
        color=(140, 140, 140),
    )
    file.log(entities.CAMERA, pinhole)
    file.log(entities.CLOUD, _cloud(observation, near_m, CLOUD_POINTS_WITH_PICTURES if pictures else CLOUD_POINTS))
    if pictures:
        _log_images(file, problem)


def _log_object(file: RecordingFile, target: Target, layout: Layout, own: RGB | None) -> None:
    """An object's meshes; ``own`` is its colour in a scene of several."""
    branch = layout.branch(target.instance.instance_id).name
    n_faces = DRAWN_FACES if own is None else DRAWN_FACES_IN_SCENE
    colors = {stage: STAGE_COLORS[stage] for stage in (*layout.worked_on, "best")}
    if own is not None:
        colors |= {"placed": own, "incumbent": own}
    for stage, color in colors.items():
        mesh = _textured(target.model) if stage in TEXTURED else None
        mesh = mesh or drawn_mesh(target.model, n_faces, color, STAGE_ALPHA[stage])
        file.log(entities.stage(branch, stage), mesh, rr.CoordinateFrame(entities.stage_frame(branch, stage)))
    if target.instance.hypotheses:
        # Hidden once the run is over: then its answers are looked at.
        file.log_at(entities.TIMELINE, 0, entities.hypotheses(branch), _ghosts(target))
    T_gt = target.instance.T_cam_obj_gt
    if T_gt is not None:
        mesh = drawn_mesh(target.model, n_faces, STAGE_COLORS["ground truth"], GROUND_TRUTH_ALPHA)
        file.log(entities.ground_truth(branch), mesh, _transform(T_gt))


def _transform(T: Float) -> rr.Transform3D:
    return rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3])


def _ghosts(target: Target) -> rr.Mesh3D:
    """All initial hypotheses as one mesh, each in its arm's colour: an entity for each would cost 6 kB."""
    vertices, faces, normals = _simplified(target.model, GHOST_FACES)
    Ts = np.array([h.T_cam_obj for h in target.instance.hypotheses], np.float32)
    n, turned = len(Ts), Ts[:, :3, :3].transpose(0, 2, 1)
    colors = np.array([ARM_COLORS[arm % len(ARM_COLORS)] for arm in range(n)], np.uint8)
    first = np.uint32(len(vertices)) * np.arange(n, dtype=np.uint32)
    return rr.Mesh3D(
        vertex_positions=(vertices @ turned + Ts[:, None, :3, 3]).reshape(-1, 3),
        vertex_normals=(normals @ turned).reshape(-1, 3),
        triangle_indices=(faces[None] + first[:, None, None]).reshape(-1, 3),
        vertex_colors=np.repeat(colors, len(vertices), axis=0),
        albedo_factor=(255, 255, 255, GHOST_ALPHA),
    )


@lru_cache(maxsize=256)
def drawn_mesh(model: ObjectModel, n_faces: int, color: RGB, alpha: int) -> rr.Mesh3D:
    """A model in one colour, with about a given number of faces."""
    vertices, faces, normals = _simplified(model, n_faces)
    return rr.Mesh3D(
        vertex_positions=vertices, triangle_indices=faces, vertex_normals=normals, albedo_factor=(*color, alpha)
    )


@lru_cache(maxsize=64)
def _textured(model: ObjectModel) -> rr.Mesh3D | None:
    skin = skin_of(model, TEXTURE_PX)
    if skin is None:
        return None
    # rerun has v down.
    return rr.Mesh3D(
        vertex_positions=skin.vertices.astype(np.float32),
        triangle_indices=skin.faces.astype(np.uint32),
        vertex_texcoords=np.column_stack([skin.uv[:, 0], 1 - skin.uv[:, 1]]),
        albedo_texture=skin.image,
    )


@lru_cache(maxsize=256)
def _simplified(
    model: ObjectModel, n_faces: int
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """A coarse mesh to draw, with smooth vertex normals."""
    vertices: Any = model.vertices.astype(np.float32)
    faces: Any = np.array(model.faces)
    if len(faces) > n_faces:
        vertices, faces = decimated(vertices, faces, n_faces)
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], across)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12)
    return vertices, faces.astype(np.uint32), normals.astype(np.float32)


def _log_images(file: RecordingFile, problem: Problem) -> None:
    observation = problem.observation
    if observation.rgb is not None:
        file.log(entities.IMAGE, rr.Image(observation.rgb).compress(jpeg_quality=85))
    # In tenths of a millimetre if they fit into 16 bits.
    units_per_m = 10_000 if observation.depth_m.max(initial=0) < 6.5 else 1_000
    # Not as PNG, which is smaller but slow to encode.
    depth = np.rint(observation.depth_m * np.float32(units_per_m)).clip(0, 65535).astype(np.uint16)
    # Pixels without depth are 0 and get the darkest colour, which no measured pixel should have.
    nearest, farthest = _depth_range(depth)
    ranged = (nearest - 0.15 * (farthest - nearest), farthest)
    image = rr.DepthImage(depth, meter=float(units_per_m), colormap="viridis", depth_range=ranged)
    file.log(entities.DEPTH, image)
    labels = np.zeros(observation.camera.shape, np.uint8)
    classes = [rr.AnnotationInfo(id=0, color=(0, 0, 0, 0))]
    for k, instance in enumerate(problem.instances[:255], start=1):
        labels[instance.mask] = k
        color = OBJECT_COLORS[(k - 1) % len(OBJECT_COLORS)]
        classes.append(rr.AnnotationInfo(k, entities.branch(instance, problem), color))
    file.log(entities.MASKS, rr.AnnotationContext(classes), rr.SegmentationImage(labels, opacity=0.35))


def _depth_range(depth: NDArray[np.uint16]) -> tuple[float, float]:
    """Range of the depths, without single outliers."""
    known = depth[::4, ::4][depth[::4, ::4] > 0]
    if not len(known):
        return 0.0, 1.0
    nearest, farthest = np.percentile(known, [1, 97])
    return float(nearest), max(float(farthest), float(nearest) + 1.0)


def _cloud(observation: Observation, near_m: float, n_points: int) -> rr.Points3D:
    """Points of every ``step``-th pixel of the objects, every ``AROUND``-th of those around them, and then of every
    ``SPARSE_PX``-th of the whole image.
    """
    mask = observation.object_mask
    if not mask.any():
        mask = np.ones_like(mask)
    top, bottom, left, right = _around_objects(mask)
    step = math.ceil(math.sqrt(np.count_nonzero(mask) / n_points))
    around = AROUND * step
    dense, sparse = np.zeros_like(mask), np.zeros_like(mask)
    dense[top:bottom:step, left:right:step] = mask[top:bottom:step, left:right:step]
    dense[top:bottom:around, left:right:around] = True
    sparse[:: max(SPARSE_PX, around), :: max(SPARSE_PX, around)] = True
    rows, columns = np.hstack([np.nonzero(dense), np.nonzero(sparse)])
    z = observation.depth_m[rows, columns]
    # Far background would shrink the objects in a view that is fitted to all points.
    is_near = (z > 0) & (z < np.float32(2.5 * near_m))
    rows, columns, z = rows[is_near], columns[is_near], z[is_near]
    camera = observation.camera
    x, y = ((columns - camera.cx) / camera.fx).astype(np.float32), ((rows - camera.cy) / camera.fy).astype(np.float32)
    grey = np.full((len(z), 3), 150, np.uint8)
    colors = grey if observation.rgb is None else observation.rgb[rows, columns]
    return rr.Points3D(np.stack([x * z, y * z, z], axis=1), colors=colors, radii=0.0012)


def _around_objects(mask: Mask) -> tuple[int, int, int, int]:
    """First and last row and column (exclusive) of a mask that is not empty, and half as much around it."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    h, w = mask.shape
    margin = int(max(rows[-1] - rows[0], columns[-1] - columns[0]) // 2) + 8
    top, bottom = max(int(rows[0]) - margin, 0), min(int(rows[-1]) + margin, h)
    return top, bottom, max(int(columns[0]) - margin, 0), min(int(columns[-1]) + margin, w)


def _depth_m(T_world_cam: Float, point_world: tuple[float, float, float]) -> float:
    """Depth of a point in front of the camera; 1 m for one that is not in front."""
    depth_m = float(T_world_cam[:3, 2] @ (point_world - T_world_cam[:3, 3]))
    return depth_m if depth_m > 0 else 1.0


def _log_support(file: RecordingFile, support: Support, layout: Layout) -> None:
    n, reach_m = support.normal_world, max(0.15, 0.7 * layout.width_m)
    corners = layout.center_world + reach_m * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    # The plane goes through the world's origin, across its normal.
    corners[:, 2] = -(corners[:, :2] @ n[:2]) / n[2] if abs(n[2]) > 0.2 else 0.0
    if support.surroundings is not None:
        _log_surroundings(file, drawn_surroundings(support.surroundings, np.array(layout.center_world), reach_m))
    else:
        plane = rr.Mesh3D(
            vertex_positions=corners,
            triangle_indices=[[0, 1, 2], [0, 2, 3]],
            vertex_normals=[n] * 4,
            albedo_factor=PLANE_COLOR,
        )
        file.log(entities.PLANE, plane)
    foot = np.append(corners[0, :2], corners[0, 2] + 0.12)
    gravity = rr.Arrows3D(origins=[foot], vectors=[[0, 0, -0.1]], colors=[GRAVITY_COLOR], labels=["gravity"])
    file.log(entities.GRAVITY, gravity)
    if support.tilt_deg > TILT_SHOWN_DEG:
        normal = rr.Arrows3D(origins=[foot], vectors=[-0.1 * n], colors=[NORMAL_COLOR], labels=["plane"])
        file.log(entities.NORMAL, normal)


def _log_surroundings(file: RecordingFile, drawn: DrawnSurroundings) -> None:
    """Log the supporting surfaces, the other solids, and each unknown object with its number."""
    for entity, (vertices, faces), color, alpha in (
        (entities.SURFACES, drawn.surfaces, SURFACE_COLOR, SURFACE_ALPHA),
        (entities.SOLIDS, drawn.solids, SOLID_COLOR, SOLID_ALPHA),
    ):
        if len(faces):
            file.log(entity, _static_mesh(vertices, faces, color, alpha))
    for one, color in drawn.unknown:
        mesh = _static_mesh(one.model.vertices, one.model.faces, color, SOLID_ALPHA)
        label = f"unknown object {one.number}{', dropped' if one.is_dropped else ''}"
        place = rr.Points3D([one.model.vertices.mean(axis=0)], radii=0.001, colors=[color], labels=[label])
        file.log(f"{entities.UNKNOWN}/{one.number}", mesh)
        file.log(f"{entities.UNKNOWN}/{one.number}/number", place)


def _static_mesh(vertices: Float, faces: NDArray[np.int32], color: RGB, alpha: int) -> rr.Mesh3D:
    """A mesh with flat faces."""
    corners = vertices[faces].reshape(-1, 3)
    a, b, c = corners[0::3], corners[1::3], corners[2::3]
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12)
    return rr.Mesh3D(
        vertex_positions=corners.astype(np.float32),
        triangle_indices=np.arange(len(corners), dtype=np.uint32).reshape(-1, 3),
        vertex_normals=np.repeat(normals, 3, axis=0).astype(np.float32),
        albedo_factor=(*color, alpha),
    )
