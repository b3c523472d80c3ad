"""A tiny problem with a known answer, and stand-ins for everything that plugs in; no heavy library needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply, axis_angle, inverse, rotation_vector, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation, Support
from verefine_viz.core.problem import Hypothesis, Instance, Placed, Problem, Target
from verefine_viz.core.records import Contacts, SimulatedPath
from verefine_viz.core.scores import PixelGrid, ScoreMaps, Scores
from verefine_viz.core.settings import ScoreSettings

BOX_M = np.array([0.10, 0.08, 0.06])


def box_model(obj_id: int = 1, name: str = "box") -> ObjectModel:
    """A box of 100 × 80 × 60 mm about its centre, with 600 surface points."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * BOX_M / 2
    faces = np.array(
        [
            [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
            [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
        ]
    )  # fmt: skip
    rng = np.random.default_rng(obj_id)
    axis, sign = rng.integers(0, 3, 600), rng.choice([-1.0, 1.0], 600)
    points = rng.uniform(-0.5, 0.5, (600, 3)) * BOX_M
    points[np.arange(600), axis] = sign * BOX_M[axis] / 2
    normals = np.zeros((600, 3))
    normals[np.arange(600), axis] = sign
    return ObjectModel(obj_id, name, corners, faces, points, normals, float(np.linalg.norm(BOX_M)), np.eye(4)[None])


def box_problem(n_hypotheses: int = 3, n_instances: int = 1, seed: int = 0) -> Problem:
    """Boxes facing an 80×60 camera, standing on a table, with disturbed ground truth as hypotheses."""
    camera = Camera(np.array([[80.0, 0, 39.5], [0, 80.0, 29.5], [0, 0, 1]]), 80, 60)
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0:60, 0:80]
    # The table: the camera looks along +z, down is +y; the plane y = 0.12 m.
    below = np.maximum(v - camera.cy, 1e-6)
    depth = np.where(v > camera.cy + 5, 0.12 * camera.fy / below, 0.0)
    depth[depth > 2.0] = 0.0
    normals = np.where(depth[..., None] > 0, [0.0, -1.0, 0.0], 0.0)
    model = box_model()
    instances = []
    object_mask = np.zeros(camera.shape, bool)
    for k in range(n_instances):
        T_gt = transform(np.eye(3), [(k - (n_instances - 1) / 2) * 0.18, 0.12 - BOX_M[1] / 2, 0.6])
        front = T_gt[2, 3] - BOX_M[2] / 2
        (u0, v0), (u1, v1) = camera.project(
            np.array([T_gt[:3, 3] - BOX_M / 2, T_gt[:3, 3] + BOX_M / 2]) * [1, 1, 0] + [0, 0, front]
        )
        mask = (u >= u0) & (u <= u1) & (v >= v0) & (v <= v1)
        depth[mask] = front
        normals[mask] = [0, 0, -1]
        object_mask |= mask
        hypotheses = tuple(
            Hypothesis(
                T_gt
                @ transform(
                    axis_angle(rng.normal(size=3), np.deg2rad(4 + 4 * j)), rng.normal(size=3) * 0.004 * (j + 1)
                ),
                1.0 - 0.1 * j,
                f"fake #{j}",
            )
            for j in range(n_hypotheses)
        )
        points = camera.back_project(np.where(mask, front, 0))[mask]
        instances.append(Instance(k, 1, mask, points, hypotheses, T_gt, 1.0))
    # World: +z = up = −y of the camera.
    R_world_cam = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    support = Support(transform(R_world_cam, [0, 0, 0.12]), np.array([0.0, 0, 1]), "plane", 1.0)
    rgb = np.full((60, 80, 3), 128, np.uint8)
    observation = Observation(camera, depth.astype(np.float32), normals.astype(np.float32), rgb, object_mask, support)
    return Problem(0, 1, observation, {1: model}, tuple(instances), "boxes")


def _gap(target: Target, T_cam_obj: Float) -> float:
    """Mean distance of the model's points to where ground truth has them [m]."""
    assert target.instance.T_cam_obj_gt is not None
    points = target.model.points
    difference = apply(T_cam_obj, points) - apply(target.instance.T_cam_obj_gt, points)
    return float(np.linalg.norm(difference, axis=1).mean())


@dataclass(frozen=True)
class FakeVerifier:
    """Judges a pose by its distance to ground truth."""

    settings: ScoreSettings = field(default_factory=ScoreSettings)

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        value = np.array([np.exp(-_gap(target, T) / 0.02) for T in Ts_cam_obj])
        n = len(value)
        counts = np.tile([80, 10, 5, 3, 2], (n, 1)).astype(np.int64)
        full = np.full(n, 100, np.int64)
        return Scores(value, value, value, full, full, counts)

    def begin(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> None:
        """Nothing: it is quick."""

    def maps(
        self, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = (), at: PixelGrid | None = None
    ) -> ScoreMaps:
        o, mask = target.observation, target.instance.mask
        zero = np.zeros(o.camera.shape, np.float32)
        rendered = np.where(mask, o.depth_m, 0).astype(np.float32)
        fit = mask.astype(np.float32)
        maps = ScoreMaps(rendered, o.normals_cam, zero, zero, fit, fit, mask, mask.astype(np.uint8))
        return maps if at is None else seen_at(maps, at)

    def score_scene(
        self, targets: Sequence[Target], Ts_cam_obj: Float, placed: Sequence[Placed] = (), whole_frame: bool = False
    ) -> Scores:
        """Mean of the single scores."""
        value = np.mean([self.score(t, Ts_cam_obj[:, k], placed).score for k, t in enumerate(targets)], axis=0)
        n = len(value)
        counts = np.tile([80, 10, 5, 3, 2], (n, 1)).astype(np.int64)
        full = np.full(n, 100, np.int64)
        return Scores(value, value, value, full, full, counts)

    def scene_maps(
        self,
        targets: Sequence[Target],
        Ts_cam_obj: Float,
        placed: Sequence[Placed] = (),
        *,
        at: PixelGrid | None = None,
    ) -> ScoreMaps:
        return self.maps(targets[0], Ts_cam_obj[0], placed, at)


def seen_at(maps: ScoreMaps, at: PixelGrid) -> ScoreMaps:
    """Maps of a whole image at some pixels."""
    seen = np.ix_(at.rows, at.columns)
    return ScoreMaps(*(None if image is None else image[seen] for image in vars(maps).values()))


@dataclass(frozen=True)
class FakeSimulator:
    """Turns the object back to upright a little and lets it sink 1 mm a step, with one contact below."""

    def settle(self, moving: Placed, fixed: Sequence[Placed], support: object, n_steps: int) -> SimulatedPath:
        T = np.array(moving.T_cam_obj)
        path = [T.copy()]
        for _ in range(n_steps):
            w = rotation_vector(T[:3, :3])
            angle = float(np.linalg.norm(w))
            if angle > 1e-9:
                T[:3, :3] = axis_angle(w, angle * 0.8)
            T[1, 3] += 0.001
            path.append(T.copy())
        below = Contacts(
            T[None, :3, 3] + [0, 0.04, 0], np.array([[0.0, -1, 0]]), np.array([1e-4]), np.array([9.81]), np.array([-1])
        )
        return SimulatedPath(np.array(path), (below,) * n_steps)


@dataclass(frozen=True)
class FakeRefiner:
    """Goes half of the way to ground truth."""

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        assert target.instance.T_cam_obj_gt is not None
        T_rest = inverse(T_cam_obj) @ target.instance.T_cam_obj_gt
        w = rotation_vector(T_rest[:3, :3])
        angle = float(np.linalg.norm(w))
        half = transform(axis_angle(w, angle / 2) if angle > 1e-9 else np.eye(3), T_rest[:3, 3] / 2)
        return T_cam_obj @ half


@dataclass
class OneFrame:
    """A scene source of one problem."""

    only: Problem
    notes: tuple[str, ...] = ()

    @property
    def frames(self) -> tuple[str, ...]:
        return (self.only.frame,)

    def problem(self, frame: str, progress: object = None) -> Problem:
        assert frame == self.only.frame
        return self.only
