"""What does not change during a run, logged once: the frame, its support plane, a mesh for everything drawn later."""

from __future__ import annotations

import io
from functools import lru_cache
from typing import Any

import fast_simplification
import numpy as np
import rerun as rr
from numpy.typing import NDArray
from PIL import Image
from rerun.chunk import Chunk

from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.palette import ARM_COLORS, RGB, STAGE_COLORS
from verefine_viz.core.problem import Problem, Target
from verefine_viz.recording import columns, entities
from verefine_viz.recording.layout import world_from_camera

CLOUD_STRIDE = 3
"""Every third pixel in each direction is drawn as a point."""
DRAWN_FACES = 1200
GHOST_FACES = 300
STAGE_ALPHA = {"current": 110, "simulated": 150, "mixed": 90, "refined": 170, "best": 230}
GHOST_ALPHA = 35
TRUTH_ALPHA = 60


def log_background(rec: rr.RecordingStream, problem: Problem) -> None:
    """Logs everything static of a frame; transforms of the stages follow with the iterations."""
    observation = problem.observation
    rec.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    support = observation.support
    T_world_cam = world_from_camera(observation)
    rec.log(entities.SCENE, rr.Transform3D(translation=T_world_cam[:3, 3], mat3x3=T_world_cam[:3, :3]), static=True)
    _log_camera(rec, observation)
    _log_cloud(rec, observation)
    _log_masks(rec, problem)
    if support:
        _log_support(rec, problem, T_world_cam)
    for target in problem.targets:
        _log_object(rec, target, entities.branch(target.instance, problem))


def _log_camera(rec: rr.RecordingStream, observation: Observation) -> None:
    camera = observation.camera
    near = _typical_depth_m(observation)
    pinhole = rr.Pinhole(
        image_from_camera=camera.K,
        resolution=[camera.width, camera.height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.12 * near,
        color=(140, 140, 140),
    )
    rec.log(entities.CAMERA, pinhole, static=True)
    if observation.rgb is not None:
        rec.log(entities.IMAGE, rr.Image(observation.rgb).compress(jpeg_quality=85), static=True)
    # Tenths of a millimetre as long as they fit 16 bits.
    units_per_m = 10_000 if observation.depth_m.max(initial=0) < 6.5 else 1_000
    # Not as PNG, which is smaller but slow to encode.
    depth = np.rint(observation.depth_m * np.float32(units_per_m)).clip(0, 65535).astype(np.uint16)
    image = rr.DepthImage(depth, meter=float(units_per_m), colormap="viridis")
    rec.log(entities.DEPTH, image, static=True)


def _log_cloud(rec: rr.RecordingStream, observation: Observation) -> None:
    step = CLOUD_STRIDE if observation.camera.width > 320 else 1
    camera, depth = observation.camera, observation.depth_m[::step, ::step]
    # Far background would only shrink what matters when the view is fitted.
    valid = (depth > 0) & (depth < 2.5 * _typical_depth_m(observation))
    v, u = np.nonzero(valid)
    z = depth[valid]
    across = ((np.arange(depth.shape[1]) * step - camera.cx) / camera.fx).astype(np.float32)
    down = ((np.arange(depth.shape[0]) * step - camera.cy) / camera.fy).astype(np.float32)
    points = np.stack([across[u] * z, down[v] * z, z], axis=-1)
    colors = np.array([150, 150, 150]) if observation.rgb is None else observation.rgb[::step, ::step][valid]
    rec.log(entities.CLOUD, rr.Points3D(points, colors=colors, radii=0.0012), static=True)


def _log_masks(rec: rr.RecordingStream, problem: Problem) -> None:
    labels = np.zeros(problem.observation.camera.shape, np.uint8)
    classes = [rr.AnnotationInfo(id=0, color=(0, 0, 0, 0))]
    for k, instance in enumerate(problem.instances[:255], start=1):
        labels[instance.mask] = k
        classes.append(rr.AnnotationInfo(k, entities.branch(instance, problem), ARM_COLORS[(k - 1) % len(ARM_COLORS)]))
    rec.log(entities.MASKS, rr.AnnotationContext(classes), rr.SegmentationImage(labels, opacity=0.35), static=True)


def _log_support(rec: rr.RecordingStream, problem: Problem, T_world_cam: NDArray[np.float64]) -> None:
    support = problem.observation.support
    assert support is not None
    clouds = [i.points_cam for i in problem.instances if len(i.points_cam)]
    if not clouds:
        return
    points = np.concatenate(clouds) @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]
    # Masks leak: a few points far behind must not decide how much of the plane is drawn.
    extent = np.ptp(np.percentile(points[:, :2], [5, 95], axis=0), axis=0)
    center, reach = np.median(points, axis=0), max(0.15, 0.7 * float(extent.max()))
    n = support.normal_world
    corners = center + reach * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    # The plane goes through the world's origin, across its normal.
    corners[:, 2] = -(corners[:, :2] @ n[:2]) / n[2] if abs(n[2]) > 0.2 else 0.0
    plane = rr.Mesh3D(
        vertex_positions=corners,
        triangle_indices=[[0, 1, 2], [0, 2, 3]],
        vertex_normals=np.tile(n, (4, 1)),
        albedo_factor=(90, 140, 160, 45),
    )
    rec.log(entities.PLANE, plane, static=True)
    foot = np.append(corners[0, :2], corners[0, 2] + 0.12)
    arrow = rr.Arrows3D(origins=[foot], vectors=[[0, 0, -0.1]], colors=[(120, 190, 220)], labels=["gravity"])
    rec.log(entities.GRAVITY, arrow, static=True)


def _log_object(rec: rr.RecordingStream, target: Target, branch: str) -> None:
    root = f"{entities.OBJECTS}/{branch}"
    T_gt = target.instance.T_cam_obj_gt
    rec.send_chunks(_meshes(target.model, branch, T_gt is not None))
    if target.instance.hypotheses:
        rec.log(f"{root}/hypotheses", _ghosts(target), static=True)
    if T_gt is not None:
        place = rr.Transform3D(translation=T_gt[:3, 3], mat3x3=T_gt[:3, :3])
        rec.log(f"{root}/ground_truth", place, static=True)


@lru_cache(maxsize=64)
def _meshes(model: ObjectModel, branch: str, has_truth: bool) -> tuple[Chunk, ...]:
    """The object in the colour of each stage, made once for all frames that show it."""
    root = f"{entities.OBJECTS}/{branch}"
    stages = [
        columns.fixed(
            f"{root}/stages/{stage}",
            _mesh(model, DRAWN_FACES, STAGE_COLORS[stage], STAGE_ALPHA[stage]),
            rr.CoordinateFrame(entities.stage_frame(branch, stage)),
        )
        for stage in entities.DRAWN_STAGES
    ]
    if has_truth:
        truth = _mesh(model, DRAWN_FACES, STAGE_COLORS["ground truth"], TRUTH_ALPHA)
        stages.append(columns.fixed(f"{root}/ground_truth", truth))
    return tuple(stages)


def _ghosts(target: Target) -> rr.Mesh3D:
    """All first hypotheses as one mesh, each in its arm's colour: an entity for each would cost 6 kB a piece."""
    vertices, faces, normals = _simplified(target.model, GHOST_FACES)
    Ts = np.array([h.T_cam_obj for h in target.instance.hypotheses])
    colors = [(*ARM_COLORS[arm % len(ARM_COLORS)], 255) for arm in range(len(Ts))]
    return rr.Mesh3D(
        vertex_positions=np.concatenate([apply(T, vertices.astype(np.float64)) for T in Ts]),
        triangle_indices=np.concatenate([faces + arm * len(vertices) for arm in range(len(Ts))]),
        vertex_normals=np.concatenate([normals @ T[:3, :3].T for T in Ts]),
        vertex_colors=np.repeat(np.array(colors, np.uint8), len(vertices), axis=0),
        albedo_factor=(255, 255, 255, GHOST_ALPHA),
    )


def _mesh(model: ObjectModel, n_faces: int, color: RGB, alpha: int) -> rr.Mesh3D:
    vertices, faces, normals = _simplified(model, n_faces)
    return rr.Mesh3D(
        vertex_positions=vertices, triangle_indices=faces, vertex_normals=normals, albedo_factor=(*color, alpha)
    )


@lru_cache(maxsize=256)
def _simplified(
    model: ObjectModel, n_faces: int
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """A coarse mesh to draw, with smooth vertex normals."""
    vertices: Any = model.vertices.astype(np.float32)
    faces: Any = np.array(model.faces)
    if len(faces) > n_faces:
        simpler: Any = fast_simplification.simplify(vertices, faces, target_count=n_faces)
        vertices, faces = simpler
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], across)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12)
    return vertices, faces.astype(np.uint32), normals.astype(np.float32)


def png(image: NDArray[np.uint8] | NDArray[np.uint16], palette: bytes | None = None) -> bytes:
    """A fast PNG of a one-channel image (H, W), with an RGB ``palette`` (768 bytes) for an indexed one."""
    picture = Image.fromarray(image)
    if palette is not None:
        picture.putpalette(palette)
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


def _typical_depth_m(observation: Observation) -> float:
    """Median depth of the objects, of everything where there is none, 1 m in a frame without depth."""
    for mask in (observation.object_mask, slice(None)):
        depth = observation.depth_m[mask]
        depth = depth[depth > 0]
        if len(depth):
            return float(np.median(depth))
    return 1.0
