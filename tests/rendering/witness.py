"""Independent witnesses: open3d casts the rays, and Eq. 1 is written out plainly in numpy from the paper's text."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache

import numpy as np
import open3d as o3d
import trimesh

from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Placed, Target
from verefine_viz.core.settings import ScoreSettings

CAMERA = Camera(np.array([[420.6, 0, 155.4], [0, 410.2, 124.4], [0, 0, 1]]), 323, 241)
"""Sizes that no power of two divides, a principal point off the middle."""


def model_of(mesh: trimesh.Trimesh, obj_id: int = 1) -> ObjectModel:
    points = mesh.vertices[:1]
    diameter = float(np.linalg.norm(mesh.extents))
    return ObjectModel(
        obj_id, f"m{obj_id}", mesh.vertices, mesh.faces, points, points * 0 + 1, diameter, np.eye(4)[None]
    )


@cache
@cache
def torus() -> ObjectModel:
    return model_of(trimesh.creation.torus(0.05, 0.02, major_sections=40, minor_sections=20), 1)


@cache
@cache
def box() -> ObjectModel:
    return model_of(trimesh.creation.box([0.06, 0.1, 0.04]), 2)


@cache
@cache
def table() -> ObjectModel:
    return model_of(trimesh.creation.box([1.0, 1.0, 0.02]), 3)


@cache
@cache
def shell() -> ObjectModel:
    """An open bowl, wound outward: its inside shows back faces."""
    mesh = trimesh.creation.icosphere(3, 0.06)
    mesh.update_faces(mesh.triangles_center[:, 2] < 0.01)
    return model_of(mesh, 4)


T_TORUS = transform(axis_angle([1, 0.3, 0.2], 0.7), [0.02, 0.01, 0.5])
T_BOX = transform(axis_angle([0.2, 1, 0], 0.4), [0.06, 0.02, 0.42])
T_TABLE = transform(axis_angle([1, 0, 0], 0.5), [0, 0.05, 0.62])


def cast(items: Sequence[tuple[ObjectModel, np.ndarray]], camera: Camera, shift_px: float = 0.0):
    """Depth (H, W), normals towards the camera (H, W, 3), labels (H, W) with -1 = nothing."""
    bodies = tuple((model, np.asarray(T, np.float64).tobytes()) for model, T in items)
    return tuple(image.copy() for image in _cast(bodies, camera, shift_px))


@lru_cache(maxsize=24)
def _cast(bodies: tuple[tuple[ObjectModel, bytes], ...], camera: Camera, shift_px: float):
    """Remembered, as several settings of the score are compared with the same few poses."""
    scene = o3d.t.geometry.RaycastingScene()
    for model, pose in bodies:
        T = np.frombuffer(pose).reshape(4, 4)
        points = model.vertices @ T[:3, :3].T + T[:3, 3]
        scene.add_triangles(points.astype(np.float32), model.faces.astype(np.uint32))
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    u, v = u + shift_px, v + shift_px
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u, float)], axis=-1)
    start = rays * 0.01
    answer = scene.cast_rays(np.concatenate([start, rays], axis=-1).astype(np.float32))
    hit = answer["t_hit"].numpy()
    seen = np.isfinite(hit)
    depth = np.where(seen, hit + 0.01, 0.0)
    normals = answer["primitive_normals"].numpy().astype(float)
    normals[(normals * rays).sum(-1) > 0] *= -1
    normals[~seen] = 0
    labels = np.where(seen, answer["geometry_ids"].numpy().astype(np.int64), -1)
    return depth, normals, labels


def target_of(seed: int = 0, noise_m: float = 0.002, missing: float = 0.05) -> Target:
    """A torus on a table, partly behind a box, seen by a noisy sensor with holes."""
    rng = np.random.default_rng(seed)
    depth, normals, labels = cast([(torus(), T_TORUS), (box(), T_BOX), (table(), T_TABLE)], CAMERA)
    depth = np.where(depth > 0, depth + rng.normal(0, noise_m, depth.shape), 0)
    normals = normals + rng.normal(0, 0.05, normals.shape) * (depth > 0)[..., None]
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    normals[rng.random(depth.shape) < missing] = 0
    depth[rng.random(depth.shape) < missing] = 0
    mask = labels == 0
    # A mask drawn by hand: a little too large on one side.
    mask |= np.roll(mask, 2, axis=1)
    observation = Observation(CAMERA, depth, normals, None, mask | (labels == 1), None)
    return Target(observation, Instance(0, 1, mask, np.zeros((0, 3)), (), T_TORUS), torus())


def disturbed(n: int, seed: int = 1, size: float = 1.0) -> np.ndarray:
    """Poses (n, 4, 4) around the torus' own, which comes first."""
    rng = np.random.default_rng(seed)
    out = [T_TORUS]
    for _ in range(n - 1):
        out.append(
            T_TORUS @ transform(axis_angle(rng.normal(size=3), rng.uniform(0, size)), rng.normal(size=3) * 0.02 * size)
        )
    return np.stack(out)


def reference(
    target: Target, T: np.ndarray, settings: ScoreSettings, placed: Sequence[Placed] = ()
) -> dict[str, object]:
    """Score and class counts of one pose, by ray casting and plain numpy."""
    camera = target.observation.camera
    shift = 0.5 if settings.pixel_centre == "half" else 0.0
    r, n_r, _ = cast([(target.model, T)], camera, shift)
    q = cast([(p.model, p.T_cam_obj) for p in placed], camera, shift)[0] if placed else np.zeros_like(r)
    d, n_d = target.observation.depth_m.astype(float), target.observation.normals_cam.astype(float)
    M, tau, alpha = target.instance.mask, settings.tau_m, settings.alpha

    f_d = np.maximum(0, 1 - np.abs(d - r) / tau)
    f_n = np.maximum(0, 1 - (1 - np.clip((n_d * n_r).sum(-1), 0, 1)) / alpha)
    both = (d > 0) & (r > 0)
    if settings.pixels == "published":
        observed = np.where(target.observation.object_mask, d, 0)
        valid = (r > 0) | (observed > 0)
        both = (r > 0) & (observed > 0)
        N = valid.sum()
        score = 0.5 * (f_d[both].sum() / N + f_n[both].sum() / N) if N else 0.0
    else:
        f_n = np.where((n_d == 0).all(-1), f_d, f_n)

    judged, near = (d > 0) & (r > 0), np.abs(d - r) < tau
    explained = judged & near & M
    sees_through = judged & (d >= r + tau)
    in_front = judged & (d <= r - tau)
    by_other = (q > 0) & (q < r) & (np.abs(d - q) < tau)
    protruding = sees_through | (judged & near & ~M & ~by_other)
    missed = (M & (d > 0) & (r == 0)) | (in_front & M & ~by_other)
    hidden = (in_front & ~(M & ~by_other)) | (judged & near & ~M & by_other)
    unknown = (r > 0) & (d == 0)
    if settings.pixels == "observed":
        N = (M & (d > 0)).sum()
        score = 0.5 * (f_d[both & M].sum() + f_n[both & M].sum()) / N if N else 0.0
    if settings.pixels == "classes":
        N = (explained | missed | protruding).sum()
        score = 0.5 * (f_d[explained].sum() + f_n[explained].sum()) / N if N else 0.0
        if (r > 0).any():
            score *= min(1.0, (1 - (hidden | unknown).sum() / (r > 0).sum()) / 0.1)
    counts = [int(c.sum()) for c in (explained, missed, protruding, hidden, unknown)]
    return {"score": float(score), "n": int(N), "counts": counts, "union": int(((r > 0) | (M & (d > 0))).sum())}


def away_from_silhouettes(depth: np.ndarray, step_m: float = 0.004) -> np.ndarray:
    """Pixels whose 3×3 neighbourhood has no depth jump and no border of the object."""
    inner = np.zeros(depth.shape, bool)
    blocks = np.stack([np.roll(depth, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    inner[1:-1, 1:-1] = ((blocks > 0).all(0) & (np.ptp(blocks, axis=0) < step_m))[1:-1, 1:-1]
    return inner
