"""The physics step of the paper: an object moves under gravity for a moment, among placed objects, on a plane.

METHODS 1.0 and 1.8 #9, #19, #20, #23, #24.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import RIGID_TOLERANCE, as_rigid, inverse
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed
from verefine_viz.core.records import Contacts, SimulatedPath
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.colliders import Collider, collider
from verefine_viz.physics.world import PlacedBody, World

FARTHEST_M = 100.0
"""Poses further than this from the camera are refused: an unfinished estimate, or millimetres taken for metres."""

PLANE_ID = -1
"""What :class:`Contacts` calls the support plane."""


class BulletSimulator:
    """Bullet with the paper's settings; same arguments, same bits, after any history and in any process."""

    def __init__(self, settings: PhysicsSettings, cache: Path | None = None) -> None:
        """A world of its own.

        Args:
            settings: step, solver, mass, friction, collider and so on.
            cache: folder of colliders already built; by default in the user's cache folder.
        """
        self._settings = settings
        self._cache = cache
        self._world = World(settings)
        self._colliders: dict[str, Collider] = {}

    def collider(self, model: ObjectModel) -> Collider:
        """The collider that stands for ``model``; built at its first use, which may take seconds.

        Raises:
            ShapeError: the mesh has no volume.
        """
        found = self._colliders.get(model.mesh_hash)
        if found is None:
            found = self._colliders[model.mesh_hash] = collider(model, self._settings.collider, self._cache)
        return found

    def settle(self, moving: Placed, fixed: Sequence[Placed], support: Support, n_steps: int) -> SimulatedPath:
        """The path of ``moving`` over ``n_steps`` steps among ``fixed`` objects on the support plane.

        Contacts are those of each step's last sub-step. The order of ``fixed`` does not matter.

        Raises:
            ShapeError: a pose is not rigid, not finite or further than ``FARTHEST_M`` away, ``n_steps`` is negative, or
                a model has no volume.
        """
        if n_steps < 0:
            raise ShapeError(f"n_steps is {n_steps}, expected 0 or more")
        T_cam_obj = _checked(moving)
        if not self._settings.enabled:
            return SimulatedPath(T_cam_obj[None], ())
        others = sorted(fixed, key=lambda placed: placed.instance_id)
        bodies, ids = self._bodies(moving, others, support.T_world_cam)
        self._world.place(bodies, _plane_quat_xyzw(support.normal_world))

        world, body = self._world, bodies[0].body
        positions, quats, touched = [], [], []
        for _ in range(n_steps):
            world.step()
            position, quat_xyzw = world.pose(body)
            positions.append(position)
            quats.append(quat_xyzw)
            touched.append(world.contacts(body))

        T_cam_world = inverse(support.T_world_cam)
        T_com_obj = inverse(self.collider(moving.model).T_obj_com)
        Ts = np.empty((n_steps + 1, 4, 4))
        Ts[0] = T_cam_obj
        if n_steps:
            Ts[1:] = T_cam_world @ _transforms(positions, quats) @ T_com_obj
        Ts.flags.writeable = False
        contacts = tuple(self._contacts(points, ids, T_cam_world) for points in touched)
        return SimulatedPath(Ts, contacts)

    def _bodies(
        self, moving: Placed, others: Sequence[Placed], T_world_cam: Float
    ) -> tuple[list[PlacedBody], dict[int, int]]:
        """Bodies at their poses, the moving one first, and the instance that each body stands for."""
        bodies: list[PlacedBody] = []
        ids = {self._world.plane: PLANE_ID}
        copies: dict[tuple[str, bool], int] = {}
        for k, placed in enumerate((moving, *others)):
            moves = k == 0 or self._settings.placed == "dynamic"
            solid = self.collider(placed.model)
            kind = (placed.model.mesh_hash, moves)
            copy = copies[kind] = copies.get(kind, -1) + 1
            body = self._world.body((placed.model.mesh_hash, copy, moves), solid)
            T_world_com = T_world_cam @ _checked(placed) @ solid.T_obj_com
            bodies.append(PlacedBody(body, T_world_com[:3, 3].tolist(), _quat_xyzw(T_world_com), moves))
            ids[body] = placed.instance_id
        return bodies, ids

    def _contacts(self, points: Sequence[tuple], ids: dict[int, int], T_cam_world: Float) -> Contacts:
        """Bullet's contact points as a record; what is near but does not touch is left out."""
        margin_m = self._settings.margin_m
        rows = []
        for p in points:
            # Bullet measures between surfaces grown by the margin; a plane has none.
            gap_m = p[8] + (margin_m if ids[p[2]] == PLANE_ID else 2 * margin_m)
            if p[9] > 0.0 or p[8] <= 0.0:
                rows.append((*p[6], *p[7], -gap_m, p[9], ids[p[2]]))
        if not rows:
            return _NO_CONTACTS
        table = np.array(rows)
        R, t = T_cam_world[:3, :3], T_cam_world[:3, 3]
        return Contacts(
            table[:, 0:3] @ R.T + t, table[:, 3:6] @ R.T, table[:, 6], table[:, 7], table[:, 8].astype(np.int64)
        )


_NO_CONTACTS = Contacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64))


def _checked(placed: Placed) -> Float:
    """The pose of ``placed``, rigid and within reach.

    Raises:
        ShapeError: it is not.
    """
    T = placed.T_cam_obj
    name = f"pose of instance {placed.instance_id}"
    if np.shape(T) != (4, 4):
        return as_rigid(T, name)
    R = T[:3, :3]
    # The comparisons are false for NaN as well; as_rigid then says what is wrong.
    if not (np.abs(R @ R.T - np.eye(3)).max() < RIGID_TOLERANCE and np.linalg.det(R) > 0):
        as_rigid(T, name)
    distance_m = float(np.abs(T[:3, 3]).max())
    if not distance_m <= FARTHEST_M:
        raise ShapeError(f"{name} is {distance_m:.4g} m away, expected at most {FARTHEST_M:g} m; is it in millimetres?")
    return T


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


def _transforms(positions: Sequence[Sequence[float]], quats_xyzw: Sequence[Sequence[float]]) -> Float:
    """Transforms (N, 4, 4) of N positions and unit quaternions."""
    x, y, z, w = np.array(quats_xyzw).T
    T = np.zeros((len(positions), 4, 4))
    T[:, 0, 0], T[:, 0, 1], T[:, 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    T[:, 1, 0], T[:, 1, 1], T[:, 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    T[:, 2, 0], T[:, 2, 1], T[:, 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    T[:, :3, 3] = positions
    T[:, 3, 3] = 1.0
    return T
