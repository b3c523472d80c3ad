"""The physics step of the paper (Sec. III-A): an object moves under gravity for a moment, among others, on a plane.

docs/methods.md 1.0 and 1.8.9, 1.8.19, 1.8.20, 1.8.23, 1.8.24; other worlds than a plane: 7.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from verefine_viz.core.arrays import Float, finite
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import FARTHEST_M, ROUNDED, apply, as_rigid, distance_m, n_within_reach, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.protocols import Simulator
from verefine_viz.core.records import Contacts, SimulatedPath
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.core.surroundings import SUPPORT_ID, SupportSurface, Surroundings
from verefine_viz.physics.colliders import Collider, boxed, collider
from verefine_viz.physics.given_parts import given_collider
from verefine_viz.physics.stability import SettlingMotion, Touch
from verefine_viz.physics.world import PLANE_FRICTION, BodyKey, PlacedBody, World, pybullet

LEVEL = 0.75
"""Upward part of the normal above which a contact with surroundings is one with the top of a surface [-]."""
_OTHER, _POINT, _NORMAL, _DISTANCE, _FORCE = 2, 6, 7, 8, 9
"""Indices of fields in a contact point of Bullet."""


@dataclass(frozen=True, eq=False)
class _Ground:
    """The support of the objects, with the transform from Bullet's world and back."""

    support: Support
    T_cam_world: Float
    supporting: tuple[SupportSurface, ...]
    """The plane, or base and surfaces of the surroundings."""
    plane_position: tuple[float, float, float]
    plane_quat_xyzw: tuple[float, float, float, float]
    bodies: dict[PlacedBody, int]
    """Bodies of the surroundings, each with its instance_id: one for all support, and one per unknown object."""


class BulletSimulator:
    """Bullet with the paper's settings; same arguments, same bits, after any history and in any process."""

    def __init__(
        self, settings: PhysicsSettings, cache: Path | None = None, progress: ProgressToken = NEVER_CANCELLED
    ) -> None:
        """Make a world of its own.

        Args:
            settings: step, solver, mass, friction, collider and so on.
            cache: folder of colliders already built; by default in the user's cache folder.
            progress: checked while a collider is built.
        """
        self._settings = settings
        self._progress = progress
        self._cache = cache
        self._world = World(settings)
        self._colliders: dict[str, Collider] = {}
        self._hulls: dict[str, tuple[Float, float]] = {}
        self._ground: _Ground | None = None
        """Ground of the last call, usually needed by the next one, too."""

    def collider(self, model: ObjectModel, progress: ProgressToken | None = None) -> Collider:
        """The collider of ``model``; built at its first use, which may take seconds.

        Several may be built on as many threads, each with a ``progress`` of its own.

        Raises:
            ShapeError: the mesh has no volume.
            InputError: the file of its parts in ``physics.collider_folder`` is unusable.
            Cancelled: through the progress token.
        """
        built = self._colliders.get(model.mesh_hash)
        if built is None:
            settings, built = self._settings, None
            if settings.collider_folder:
                built = given_collider(model, Path(settings.collider_folder), settings.collider_unit_m)
            built = built or collider(model, settings.collider, self._cache, progress or self._progress)
            built = boxed(built) if settings.inertia == "box" else built
            self._colliders[model.mesh_hash] = built
        return built

    def settle(self, moving: Placed, fixed: Sequence[Placed], support: Support, n_steps: int) -> SimulatedPath:
        """The path of ``moving`` over ``n_steps`` steps among ``fixed`` objects on the support plane, or in the
        surroundings that ``support`` has instead.

        Contacts are those of each step's last sub-step. The order of ``fixed`` does not matter. The path ends early
        where the object would leave the reach of the camera, ``FARTHEST_M``. A longer path starts with the shorter one,
        except where it leaves the first surface of the surroundings.

        Raises:
            ShapeError: a given pose is not rigid, not finite or beyond that reach, ``n_steps`` is negative, or a
                model has no volume.
        """
        if n_steps < 0:
            raise ShapeError(f"n_steps is {n_steps}, expected 0 or more")
        T_cam_obj = checked_pose(moving)
        if not self._settings.enabled:
            return SimulatedPath(T_cam_obj[None], ())
        # Bullet is fastest with a plane, which also pushes up what starts deep inside of it.
        without_end = support.with_first_endless
        if without_end is not None and self._is_over_first(support, moving.model, T_cam_obj[None]):
            path = self._settled(moving, fixed, without_end, n_steps)
            if self._is_over_first(support, moving.model, path.Ts_cam_obj):
                return path
        return self._settled(moving, fixed, support, n_steps)

    def _is_over_first(self, support: Support, model: ObjectModel, Ts_cam_obj: Float) -> bool:
        """Whether an object is over the first surface of surroundings in all poses (N, 4, 4), however it turns."""
        assert support.surroundings is not None
        first = support.surroundings.surfaces[0]
        com = (support.T_world_cam @ Ts_cam_obj @ self.collider(model).T_obj_com)[:, :3, 3]
        return bool((first.heights(com) > 0).all() and first.reaches(com[:, :2], -self._hull_com(model)[1]).all())

    def _settled(self, moving: Placed, fixed: Sequence[Placed], support: Support, n_steps: int) -> SimulatedPath:
        others = sorted(fixed, key=lambda placed: placed.instance_id)
        bodies, ids = self._bodies((moving, *others), support.T_world_cam)
        ground, T_cam_obj = self._under(support), np.asarray(moving.T_cam_obj)
        ids.update((placed.body, instance_id) for placed, instance_id in ground.bodies.items())
        self._world.place([*bodies, *ground.bodies], ground.plane_position, ground.plane_quat_xyzw)

        world, body = self._world, bodies[0].body
        poses: list[tuple[Sequence[float], Sequence[float]]] = [(bodies[0].position, bodies[0].quat_xyzw)]
        near: list[tuple[tuple, ...]] = []
        touched: list[tuple] = []
        ends: list[int] = []
        for _ in range(n_steps):
            world.step()
            poses.append(world.pose(body))
            near.append(world.contacts(body))
            # Points that are near but do not touch are left out.
            touched += [p for p in near[-1] if p[_FORCE] > 0.0 or p[_DISTANCE] <= 0.0]
            ends.append(len(touched))

        solid, Ts_world_com = self.collider(moving.model), _transforms(poses)
        Ts = ground.T_cam_world @ Ts_world_com @ solid.T_com_obj
        Ts[0] = T_cam_obj
        n = n_within_reach(Ts)
        if n < len(Ts):
            Ts, Ts_world_com, ends = Ts[:n], Ts_world_com[:n], ends[: n - 1]
            touched = touched[: ends[-1] if ends else 0]
        Ts.flags.writeable = False
        tipping = None
        if touched and self._settings.gravity_m_s2 > 0:  # Without gravity nothing tips over.
            standing = SettlingMotion(
                Ts_world_com,
                lambda step: self._touches(near[step - 1], poses[step][0], ids),
                self._hull_com(moving.model)[0],
                ground.supporting,
                self._settings.step_s,
            )
            tipping = standing.tipping()
        return SimulatedPath(Ts, self._contacts(touched, ids, ground.T_cam_world).split(ends), tipping)

    def _hull_com(self, model: ObjectModel) -> tuple[Float, float]:
        """Corners (n, 3) of the mesh's convex hull, centre-of-mass frame, and the distance of the farthest [m]."""
        hull = self._hulls.get(model.mesh_hash)
        if hull is None:
            solid = model.vertices[np.unique(model.faces)]
            corners = solid[ConvexHull(solid).vertices]
            hull_com = apply(self.collider(model).T_com_obj, corners)
            hull = self._hulls[model.mesh_hash] = hull_com, float(np.linalg.norm(hull_com, axis=1).max())
        return hull

    def _under(self, support: Support) -> _Ground:
        if self._ground is None or self._ground.support is not support:
            R_cam_world = support.T_world_cam[:3, :3].T
            T_cam_world = transform(R_cam_world, -(R_cam_world @ support.T_world_cam[:3, 3]))
            around = support.surroundings
            supporting = around.supporting if around is not None else (plane_of(support),)
            base = supporting[0]
            x, y, z = (-base.offset_m * base.normal_world).tolist()
            quat_xyzw = _plane_quat_xyzw(support.normal_world if around is None else base.normal_world)
            bodies = self._around(around) if around is not None else {}
            self._ground = _Ground(support, T_cam_world, supporting, (x, y, z), quat_xyzw, bodies)
        return self._ground

    def _around(self, surroundings: Surroundings) -> dict[PlacedBody, int]:
        parts: dict[int, list[ObjectModel]] = {}
        for instance_id, model in surroundings.bodies:
            parts.setdefault(instance_id, []).append(model)
        bodies = {}
        for instance_id, models in parts.items():
            friction = PLANE_FRICTION if instance_id == SUPPORT_ID else self._settings.friction
            key = BodyKey(tuple(model.mesh_hash for model in models), 0, False)
            body = self._world.solid(key, [model.vertices for model in models], friction)
            bodies[PlacedBody(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), False)] = instance_id
        return bodies

    def _bodies(self, cast: Sequence[Placed], T_world_cam: Float) -> tuple[list[PlacedBody], dict[int, int]]:
        """Bodies at their poses, in the order of ``cast``, whose first one moves, and the instance of each body."""
        if self._world.is_full:
            self._world.close()
            self._world, self._ground = World(self._settings), None
        hashes = tuple(placed.model.mesh_hash for placed in cast)
        all_move = self._settings.placed == "dynamic"
        bodies: list[PlacedBody] = []
        ids = {self._world.plane: SUPPORT_ID}
        for k, placed in enumerate(cast):
            if all_move:
                key = BodyKey(hashes, k, True)
            else:
                key = BodyKey(hashes[k : k + 1], hashes[1:k].count(hashes[k]), k == 0)
            solid = self.collider(placed.model)
            body = self._world.body(key, solid)
            T_world_com = T_world_cam @ checked_pose(placed) @ solid.T_obj_com
            bodies.append(PlacedBody(body, T_world_com[:3, 3].tolist(), _quat_xyzw(T_world_com), key.moves))
            ids[body] = placed.instance_id
        return bodies, ids

    def _touches(self, near: Sequence[tuple], com: Sequence[float], ids: dict[int, int]) -> list[Touch]:
        """Points that Bullet reports as near after a step, relative to the centre of mass."""
        x, y, _ = com
        margin_m, touches = self._settings.margin_m, []
        for p in near:
            is_plane, (px, py, _), up = p[_OTHER] == self._world.plane, p[_POINT], p[_NORMAL][2]
            is_support = is_plane or (ids[p[_OTHER]] == SUPPORT_ID and up > LEVEL)
            gap_m = p[_DISTANCE] + (margin_m if is_plane else 2 * margin_m)
            touches.append(
                Touch((px - x, py - y), up, gap_m, p[_FORCE] > 0.0 or p[_DISTANCE] <= 0.0, is_plane, is_support)
            )
        return touches

    def _contacts(self, touched: Sequence[tuple], ids: dict[int, int], T_cam_world: Float) -> Contacts:
        """Bullet's contact points as records."""
        # Bullet measures between surfaces grown by the margin; a plane has none.
        margins_m = {body: self._settings.margin_m * (1 if body == self._world.plane else 2) for body in ids}
        flat = np.array([(*p[_POINT], *p[_NORMAL], -p[_DISTANCE] - margins_m[p[_OTHER]], p[_FORCE]) for p in touched])
        flat = flat.reshape(len(touched), 8)
        R, t = T_cam_world[:3, :3], T_cam_world[:3, 3]
        points, normals = flat[:, :3] @ R.T + t, flat[:, 3:6] @ R.T
        # Bullet divides the last sub-step's impulse by the whole step.
        depths_m, forces_n = flat[:, 6], flat[:, 7] * self._settings.substeps
        others = np.array([ids[p[_OTHER]] for p in touched], dtype=np.int64)
        for column in (points, normals, depths_m, forces_n, others):
            column.flags.writeable = False  # Frozen, so that records take it without a copy.
        return Contacts(points, normals, depths_m, forces_n, others)


def checked_pose(placed: Placed) -> Float:
    """The pose of ``placed``.

    Raises:
        ShapeError: it is not rigid, or out of reach.
    """
    T = np.asarray(placed.T_cam_obj)
    name = f"pose of instance {placed.instance_id}"
    if T.shape != (4, 4):
        as_rigid(T, name)
    (a, b, c, _), (d, e, f, _), (g, h, i, _), _ = T.tolist()
    norms = abs(a * a + b * b + c * c - 1) + abs(d * d + e * e + f * f - 1) + abs(g * g + h * h + i * i - 1)
    angles = abs(a * d + b * e + c * f) + abs(a * g + b * h + c * i) + abs(d * g + e * h + f * i)
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    # The comparison is false for NaN as well; as_rigid then raises what is wrong.
    if not (norms + angles <= ROUNDED and determinant > 0):
        T = as_rigid(T, name)
    away_m = distance_m(T)
    if not away_m <= FARTHEST_M:
        finite(T, name, (4, 4))
        raise ShapeError(f"{name} is {away_m:.4g} m away, expected at most {FARTHEST_M:g} m; is it in millimetres?")
    return T


def plane_of(support: Support) -> SupportSurface:
    """The support plane, which goes through the world's origin."""
    normal = support.normal_world / np.linalg.norm(support.normal_world)
    return SupportSurface(normal, 0.0, np.zeros((0, 2)))


def _quat_xyzw(T: Float) -> tuple[float, float, float, float]:
    """Unit quaternion of a transform's rotation, the largest component positive; plain floats, for speed."""
    (a, b, c), (d, e, f), (g, h, i) = T[:3, :3].tolist()
    four = (1 + a - e - i, 1 - a + e - i, 1 - a - e + i, 1 + a + e + i)  # 4x², 4y², 4z², 4w²
    largest = four.index(max(four))
    if largest == 3:
        q = (h - f, c - g, d - b, four[3])
    elif largest == 0:
        q = (four[0], b + d, c + g, h - f)
    elif largest == 1:
        q = (b + d, four[1], f + h, c - g)
    else:
        q = (c + g, f + h, four[2], d - b)
    n = sum(x * x for x in q) ** 0.5
    return q[0] / n, q[1] / n, q[2] / n, q[3] / n


def _plane_quat_xyzw(normal_world: Float) -> tuple[float, float, float, float]:
    """The shortest rotation that turns +z into the plane's normal."""
    x, y, z = (normal_world / np.linalg.norm(normal_world)).tolist()
    q = (-y, x, 0.0, 1.0 + z)
    n = sum(v * v for v in q) ** 0.5
    return q[0] / n, q[1] / n, 0.0, q[3] / n


def _transforms(poses: Sequence[tuple[Sequence[float], Sequence[float]]]) -> Float:
    """Transforms (N, 4, 4) of N positions and unit quaternions (x, y, z, w)."""
    T = np.zeros((len(poses), 4, 4))
    T[:, :3, 3] = [position for position, _ in poses]
    T[:, :3, :3] = np.array([pybullet.getMatrixFromQuaternion(quat) for _, quat in poses]).reshape(-1, 3, 3)
    T[:, 3, 3] = 1.0
    return T


def settle_to_rest(
    simulator: Simulator,
    moving: Placed,
    fixed: Sequence[Placed],
    support: Support,
    max_steps: int = 600,
    still_steps: int = 15,
    still_m: float = 2e-4,
) -> SimulatedPath:
    """The path of ``moving`` from a drop until it lies still, as built-in scenes are laid out.

    Args:
        simulator: the simulator; its steps are 1/60 s by default.
        moving: the object and the pose it is dropped in.
        fixed: objects already placed.
        support: plane and gravity.
        max_steps: most steps; the path may then end in motion. 600 are 10 s.
        still_steps: the object lies still when over this many steps …
        still_m: … none of its vertices moved farther than this [m].

    Returns:
        The path up to the first moment at which it has lain still.
    """
    n_steps = min(60, max_steps)
    # Answers depend on the arguments only, so a longer path starts with the shorter one: run again, twice as long.
    while True:
        path = simulator.settle(moving, fixed, support, n_steps)
        end = _first_still(path.Ts_cam_obj, moving.model.vertices, still_steps, still_m)
        if end is not None:
            return SimulatedPath(path.Ts_cam_obj[: end + 1], path.contacts[:end])
        if n_steps >= max_steps:
            return path
        n_steps = min(2 * n_steps, max_steps)


def _first_still(Ts: Float, vertices: Float, still_steps: int, still_m: float) -> int | None:
    """Index of the first pose that differs little from all of the ``still_steps`` poses before it."""
    corners = np.array(np.meshgrid(*zip(vertices.min(axis=0), vertices.max(axis=0), strict=True))).reshape(3, -1)
    tracks = Ts[:, :3, :3] @ corners + Ts[:, :3, 3:]
    for end in range(still_steps, len(Ts)):
        moved_m = np.linalg.norm(tracks[end - still_steps : end] - tracks[end], axis=1)
        if moved_m.max() <= still_m:
            return end
    return None
