"""A Bullet world whose answers do not depend on what was simulated in it before.

Bullet remembers: contact caches, the order of its broad phase, the order in which bodies were made. Placing bodies
again is therefore not enough; see :meth:`World.place`. Everything here is about centre-of-mass frames, quaternions
(x, y, z, w) and world coordinates; camera and object frames end in ``simulator.py``.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from verefine_viz.core.arrays import Float
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.colliders import Collider


@contextmanager
def _stderr_closed() -> Iterator[None]:
    """Pybullet writes a line about its build when it is imported, from C: so it is the descriptor that is closed."""
    stderr, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(nowhere)


with _stderr_closed():
    import pybullet
    from pybullet_utils.bullet_client import BulletClient


Vector = Sequence[float]
MAX_BODIES = 48
"""Bodies in one world; every parked one costs 0.3 µs per step."""

PLANE_FRICTION = 1.0
BULLET_DAMPING = 0.04
"""What Bullet gives to a new body, in single precision: left alone where it is what is wanted."""
LARGEST_DAMPING = 1 - 1e-6
"""Stands for a share of 1, which no finite rate takes away."""

_MOVES, _STAYS = 1, 2
"""Collision groups: what moves meets everything, what stays meets what moves."""

_ASLEEP = pybullet.ACTIVATION_STATE_ENABLE_SLEEPING | pybullet.ACTIVATION_STATE_SLEEP
_AWAKE = pybullet.ACTIVATION_STATE_DISABLE_SLEEPING | pybullet.ACTIVATION_STATE_WAKE_UP
"""A body that sleeps is left out of the equations of motion: what is parked, and what never moves."""


@dataclass(frozen=True)
class BodyKey:
    """Which body stands for an object.

    Bullet solves contacts among moving bodies in the order in which the bodies were made. Where several move, each
    group (the meshes that move together, in order) therefore has bodies of its own.
    """

    group: tuple[str, ...]
    """Mesh hashes of all that move together; of the object alone where the others stay; of all solids that
    surroundings are made of."""
    copy: int
    """Number in the group, or of the copy: two cups are two bodies."""
    moves: bool


@dataclass(frozen=True)
class PlacedBody:
    """A body and where to put its centre of mass."""

    body: int
    position: Vector
    quat_xyzw: Vector
    moves: bool


class QuietClient(BulletClient):
    """A private Bullet world without a window, connected without the lines that Bullet prints for it."""

    def __init__(self) -> None:
        self._shapes: dict[int, object] = {}
        self._pid = os.getpid()
        self._client = pybullet.connect(pybullet.DIRECT)


class World:
    """One Bullet world: the support plane and every body made so far, parked where it is not used."""

    def __init__(self, settings: PhysicsSettings) -> None:
        self._settings = settings
        self._bullet = QuietClient()
        if settings.placed == "dynamic":
            # What the usual broad phase does with pairs that lie apart depends on how many steps were ever made, and
            # bodies of one group of pairs are solved together. Where one body moves, there is one group.
            self._bullet.resetSimulation(pybullet.RESET_USE_SIMPLE_BROADPHASE)
        self._bullet.setPhysicsEngineParameter(
            fixedTimeStep=settings.step_s,
            numSubSteps=settings.substeps,
            numSolverIterations=settings.solver_iterations,
            deterministicOverlappingPairs=1,
        )
        self._bullet.setGravity(0, 0, -settings.gravity_m_s2)
        self.plane = self._bullet.createMultiBody(0, self._bullet.createCollisionShape(pybullet.GEOM_PLANE))
        self._bullet.changeDynamics(self.plane, -1, lateralFriction=PLANE_FRICTION)
        self._bullet.changeDynamics(self.plane, -1, activationState=_ASLEEP)
        self._bodies: dict[BodyKey, int] = {}
        self._in_use: set[int] = set()
        self._asleep: set[int] = set()
        # Each attribute of a BulletClient makes a new partial; those of the inner loop are made once.
        self.step = self._bullet.stepSimulation
        self.pose = self._bullet.getBasePositionAndOrientation
        self.contacts = self._bullet.getContactPoints
        self._reset = self._bullet.resetBasePositionAndOrientation
        self._filter = self._bullet.setCollisionFilterGroupMask

    def body(self, key: BodyKey, collider: Collider) -> int:
        """The body of ``key``, made at its first use and parked."""
        body = self._bodies.get(key)
        if body is None:
            body = self._bodies[key] = self._made(collider, key.moves)
            self._park(body)
        return body

    def solid(self, key: BodyKey, parts: Sequence[Float], friction: float) -> int:
        """The body of ``key`` that never moves, of convex ``parts`` (n, 3) in the world [m]; made at its first use."""
        body = self._bodies.get(key)
        if body is None:
            body = self._bodies[key] = convex_body(
                self._bullet, parts, np.eye(4), 0.0, friction, self._settings.margin_m
            )
            self._park(body)
        return body

    @property
    def is_full(self) -> bool:
        """Whether so many bodies are parked that a new world is better; its answers are the same."""
        return len(self._bodies) >= MAX_BODIES

    def close(self) -> None:
        """Give back the memory of this world."""
        self._bullet.disconnect()

    def place(self, bodies: Sequence[PlacedBody], plane_position: Vector, plane_quat_xyzw: Vector) -> None:
        """Put ``bodies`` and the plane in place, at rest, without any memory of former contacts; park all others.

        Entering a body's collision filter makes Bullet drop all its pairs with their cached contacts, and number it
        again in the broad phase. Done for plane and bodies in the caller's order, the world is the same after every
        history; ``deterministicOverlappingPairs`` then works in this order.
        """
        in_use = {b.body for b in bodies}
        for body in self._in_use - in_use:
            self._park(body)
        self._in_use = in_use
        self._wake([b.body for b in bodies if b.moves and b.body in self._asleep])
        self._reset(self.plane, plane_position, plane_quat_xyzw)
        for b in bodies:
            self._reset(b.body, b.position, b.quat_xyzw)
        self._filter(self.plane, -1, _STAYS, _MOVES)
        for b in bodies:
            self._filter(b.body, -1, _MOVES if b.moves else _STAYS, _MOVES | _STAYS if b.moves else _MOVES)

    def _park(self, body: int) -> None:
        """Far away, meeting nothing, asleep."""
        self._filter(body, -1, 0, 0)
        self._reset(body, (0.0, 0.0, 1000.0 + 100.0 * body), (0.0, 0.0, 0.0, 1.0))
        self._bullet.changeDynamics(body, -1, activationState=_ASLEEP)
        self._asleep.add(body)

    def _wake(self, bodies: Sequence[int]) -> None:
        """Bullet takes note of it at the end of a step, so one is made while all that wake are still apart."""
        for body in bodies:
            self._bullet.changeDynamics(body, -1, activationState=_AWAKE)
        if bodies:
            self._asleep.difference_update(bodies)
            self.step()

    def _made(self, collider: Collider, moves: bool) -> int:
        settings = self._settings
        mass_kg = settings.mass_kg if moves else 0.0
        body = convex_body(
            self._bullet, collider.parts, collider.T_obj_com, mass_kg, settings.friction, settings.margin_m
        )
        if moves:
            inertia = (collider.inertia_m2 * mass_kg).tolist()
            self._bullet.changeDynamics(body, -1, localInertiaDiagonal=inertia)
            if settings.damping != BULLET_DAMPING:
                rate = _damping_rate(settings.damping)
                self._bullet.changeDynamics(body, -1, linearDamping=rate, angularDamping=rate)
        return body


def convex_body(
    bullet: BulletClient, parts: Sequence[Float], T_obj_com: Float, mass_kg: float, friction: float, margin_m: float
) -> int:
    """A new body of convex ``parts`` (n, 3) in the object frame [m], its centre of mass at the origin."""
    with tempfile.TemporaryDirectory() as folder:  # A new name each time: Bullet caches files by name.
        path = Path(folder) / "parts.obj"
        path.write_text(_wavefront(parts, T_obj_com), encoding="ascii")
        shape = bullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(path))
    body = bullet.createMultiBody(mass_kg, shape)
    bullet.changeDynamics(body, -1, lateralFriction=friction, collisionMargin=margin_m)
    return body


def _damping_rate(share: float) -> float:
    """What Bullet's articulated bodies, which pybullet makes, want for a damping by ``share`` of the speed a second.

    Their damping is a rate [1/s] (times 1 + the speed), where that of Bullet's plain rigid bodies, which others use, is
    the share itself: 0.99 taken for a rate would leave a third of the speed instead of a hundredth.
    """
    return -math.log1p(-min(share, LARGEST_DAMPING))


def _wavefront(parts: Sequence[Float], T_obj_com: Float) -> str:
    """Convex parts (n, 3) in the centre-of-mass frame, one object each, as Bullet reads them from a file."""
    R, t = T_obj_com[:3, :3], T_obj_com[:3, 3]
    lines: list[str] = []
    first = 1
    for k, part in enumerate(parts):
        lines.append(f"o part{k}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in (part - t) @ R]
        lines += [f"f {a + first} {b + first} {c + first}" for a, b, c in ConvexHull(part).simplices]
        first += len(part)
    return "\n".join(lines) + "\n"
