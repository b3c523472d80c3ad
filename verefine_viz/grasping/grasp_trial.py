"""Carries out one grasp in Bullet: approach, close, lift, shake, hold. Same arguments, same bits.

Every trial has a world of its own. Objects start at their true poses and can move; the gripper goes to the estimated
pose. Source: Sec. V-D, in simulation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import quat_wxyz, transform
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.grasping.grasp_verdict import Verdict
from verefine_viz.grasping.gripper import APPROACH_M, FINGER_M, PALM_FRONT_M, PALM_M, TIP_M
from verefine_viz.physics.colliders import Collider
from verefine_viz.physics.world import PLANE_FRICTION, QuietClient, convex_body, pybullet

STEP_S = 1 / 240
SOLVER_ITERATIONS = 60
MARGIN_M = 1e-4
OBJECT_FRICTION = 0.5
"""Friction coefficient of objects, among each other and, times the plane's, on the plane."""
SETTLE_S, CLOSE_S, HOLD_S = 0.25, 0.9, 0.5
"""Time for the objects to come to rest, for the fingers to close, and for holding at the end [s]."""
APPROACH_M_S, LIFT_M_S = 0.15, 0.25
LIFT_M = 0.15
"""Height by which the object is lifted [m]."""
STOP_N = 10.0
"""Force on an approaching gripper from which it has collided [N]."""
SHAKES, SHAKE_M, SHAKE_S = 2, 0.015, 0.5
"""Number of shakes, their amplitude [m] and their duration [s]."""
FINGER_M_S = 0.12
ARM_N = 400.0
"""Largest force along each axis of the arm [N]."""
STABLE_M = 0.01
"""Motion in the gripper, while held, from which an object is slipping [m]."""
LIFTED = 0.5
"""Least rise of the object, as a share of the lift: one that hangs from the pads rises less than the hand."""
PAD_M = 0.0066
"""Radius at which friction resists a turn about the line between the pads: 2/3 of half a pad's width [m]."""
SHOWN_EVERY = 8
"""Steps between two moments of the path, which has 30 per second."""
_X, _Y, _Z, _LEFT, _RIGHT = range(5)
"""Indices of the joints."""


@dataclass(frozen=True, eq=False)
class Body:
    """An object of the scene."""

    instance_id: int
    collider: Collider
    T_world_obj: Float
    """(4, 4) its true pose [m]."""


@dataclass(frozen=True, eq=False)
class GraspContact:
    """A contact of the gripper."""

    instance_id: int | None
    """The object; None = the support plane."""
    point_world: Float
    """(3,) [m]."""
    force_n: float


@dataclass(frozen=True, eq=False)
class GraspPath:
    """Course of a grasp, 30 times per second."""

    verdict: Verdict
    stages: tuple[str, ...]
    """Stage of each of N moments: settle, approach, close, lift, shake or hold."""
    Ts_world_gripper: Float
    """(N, 4, 4) [m]."""
    gaps_m: Float
    """(N,) distance between the fingers."""
    Ts_world_obj: Mapping[int, Float]
    """(N, 4, 4) of each object, by instance_id [m]."""
    forces_n: Float
    """(N, 2) of the fingers on the target [N]."""
    contacts: tuple[tuple[GraspContact, ...], ...]
    """Contacts of the gripper at each of N moments."""

    @property
    def n_moments(self) -> int:
        return len(self.stages)


class GraspWorld:
    """Bullet with the objects of a scene on a plane, and the gripper; for one trial."""

    def __init__(self, bodies: Sequence[Body], target: int, plane_normal: Float, settings: GraspSettings) -> None:
        """Build the world; ``target`` is the instance_id of the object to grasp."""
        self._settings, self._bodies = settings, {body.instance_id: body for body in bodies}
        self._bullet = bullet = QuietClient()
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=STEP_S,
            numSubSteps=0,
            numSolverIterations=SOLVER_ITERATIONS,
            deterministicOverlappingPairs=1,
        )
        bullet.setGravity(0, 0, -9.81)
        plane = bullet.createCollisionShape(pybullet.GEOM_PLANE, planeNormal=plane_normal.tolist())
        self._plane = bullet.createMultiBody(0, plane)
        bullet.changeDynamics(self._plane, -1, lateralFriction=PLANE_FRICTION)
        self._ids: dict[int, int] = {}
        self._target = -1
        for body in sorted(bodies, key=lambda b: b.instance_id):
            self._ids[body.instance_id] = self._made(body)
        self._target = self._ids.get(target, -1)
        self._instance_of = {body: instance_id for instance_id, body in self._ids.items()}
        self._hand = -1
        self._frames: list[tuple] = []
        self._progress = NEVER_CANCELLED

    def _made(self, body: Body) -> int:
        solid, mass = body.collider, self._settings.mass_kg
        made = convex_body(self._bullet, solid.parts, solid.T_obj_com, mass, OBJECT_FRICTION, MARGIN_M)
        inertia = (solid.inertia_m2 * mass).tolist()
        self._bullet.changeDynamics(made, -1, localInertiaDiagonal=inertia)
        T = body.T_world_obj @ solid.T_obj_com
        self._bullet.resetBasePositionAndOrientation(made, T[:3, 3].tolist(), _quat_xyzw(T))
        return made

    def run(self, T_world_grasp: Float, progress: ProgressToken = NEVER_CANCELLED) -> GraspPath:
        """Carry out the grasp; ``T_world_grasp`` (4, 4) is the gripper's pose when it closes [m].

        Raises:
            Cancelled: through ``progress``.
        """
        self._progress = progress
        try:
            verdict = self._run(T_world_grasp)
        finally:
            self._bullet.disconnect()
        return self._path(verdict)

    def _run(self, T_world_grasp: Float) -> Verdict:
        R = T_world_grasp[:3, :3]
        self._hand = self._gripper(T_world_grasp)
        back = np.array([0.0, 0.0, -APPROACH_M])
        up = R.T @ np.array([0.0, 0.0, LIFT_M])
        self._drive(back, back, SETTLE_S, "settle", grips=False)
        if (hit := self._drive(back, np.zeros(3), APPROACH_M / APPROACH_M_S, "approach", grips=False)) is not None:
            return hit
        self._drive(np.zeros(3), np.zeros(3), CLOSE_S, "close", grips=True)
        if min(self._finger_forces()) <= 0.0:
            return "no contact"
        low_m = self._height()
        self._drive(np.zeros(3), up, LIFT_M / LIFT_M_S, "lift", grips=True)
        across = R.T @ np.array([[SHAKE_M, 0.0, 0.0], [0.0, SHAKE_M, 0.0]]).T
        for k in range(SHAKES):
            side = across[:, k % 2]
            self._drive(up, up, SHAKE_S, "shake", grips=True, swing=side)
        held = self._com_in_palm()
        self._drive(up, up, HOLD_S, "hold", grips=True)
        is_stable = float(np.linalg.norm(self._com_in_palm() - held)) <= STABLE_M
        is_up = self._height() - low_m >= LIFTED * LIFT_M
        # A pad may leave a round body for a step: contact is counted over the whole time.
        pressed_n = np.mean([frame[4] for frame in self._frames if frame[0] == "hold"], axis=0)
        return "success" if is_stable and is_up and min(pressed_n) > 0.0 else "slipped"

    def _gripper(self, T_world_grasp: Float) -> int:
        """Three sliding axes of an arm, the palm and two fingers, in the grasp's frame with the fingers open."""
        bullet, s = self._bullet, self._settings
        arm = bullet.createCollisionShape
        px, py, pz = PALM_M
        fx, fy = FINGER_M
        length = TIP_M - PALM_FRONT_M
        palm = arm(pybullet.GEOM_BOX, halfExtents=(px / 2, py / 2, pz / 2))
        pad = arm(pybullet.GEOM_BOX, halfExtents=(fx / 2, fy / 2, length / 2))
        middle_z = PALM_FRONT_M - pz / 2
        out_y = s.opening_m / 2 + fy / 2
        out_z = PALM_FRONT_M + length / 2 - middle_z
        T = T_world_grasp @ transform(np.eye(3), [0.0, 0.0, -APPROACH_M])
        still = (0.0, 0.0, 0.0, 1.0)
        at = [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, middle_z), (0.0, -out_y, out_z), (0.0, out_y, out_z)]
        hand = bullet.createMultiBody(
            baseMass=0,
            basePosition=T[:3, 3].tolist(),
            baseOrientation=_quat_xyzw(T),
            linkMasses=[0.5, 0.5, 0.8, 0.1, 0.1],
            linkCollisionShapeIndices=[-1, -1, palm, pad, pad],
            linkVisualShapeIndices=[-1] * 5,
            linkPositions=at,
            linkOrientations=[still] * 5,
            linkInertialFramePositions=[(0.0, 0.0, 0.0)] * 5,
            linkInertialFrameOrientations=[still] * 5,
            linkParentIndices=[0, 1, 2, 3, 3],
            linkJointTypes=[pybullet.JOINT_PRISMATIC] * 5,
            linkJointAxis=[(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 1, 0), (0, -1, 0)],
            flags=pybullet.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS,
        )
        # One property a call: with damping in the same call, Bullet leaves the friction of a link as it was.
        for link in range(5):
            bullet.changeDynamics(hand, link, linearDamping=0, angularDamping=0, jointDamping=0)
            bullet.changeDynamics(hand, link, jointLowerLimit=-10, jointUpperLimit=10)
            # Bullet multiplies the coefficients of both bodies.
            bullet.changeDynamics(hand, link, lateralFriction=s.friction / OBJECT_FRICTION)
        for link in (_LEFT, _RIGHT):
            bullet.changeDynamics(hand, link, spinningFriction=PAD_M)
            bullet.changeDynamics(hand, link, jointLowerLimit=0, jointUpperLimit=s.opening_m / 2)
        # One motor closes both fingers: with one each, both would drift to one side with the object between them.
        gear = bullet.createConstraint(
            hand, _LEFT, hand, _RIGHT, pybullet.JOINT_GEAR, (0, 1, 0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        )
        bullet.changeConstraint(gear, gearRatio=-1, erp=0.2, maxForce=ARM_N)
        return hand

    def _drive(
        self, start: Float, end: Float, seconds: float, stage: str, grips: bool, swing: Float | None = None
    ) -> Verdict | None:
        """Move the arm, in the frame of the grasp; return what it collides with on an approach."""
        bullet, s = self._bullet, self._settings
        n = max(1, round(seconds / STEP_S))
        base = np.array([0.0, 0.0, -APPROACH_M])
        for k in range(1, n + 1):
            share = k / n
            # The motion starts and ends at rest.
            smooth = share * share * (3 - 2 * share)
            at = start + smooth * (end - start)
            if swing is not None:
                at = at + np.sin(2 * np.pi * share) * swing
            bullet.setJointMotorControlArray(
                self._hand,
                [_X, _Y, _Z],
                pybullet.POSITION_CONTROL,
                targetPositions=(at - base).tolist(),
                positionGains=[0.5] * 3,
                velocityGains=[1.0] * 3,
                forces=[ARM_N] * 3,
            )
            bullet.setJointMotorControlArray(
                self._hand,
                [_LEFT, _RIGHT],
                pybullet.VELOCITY_CONTROL,
                targetVelocities=[FINGER_M_S if grips else -FINGER_M_S] * 2,
                forces=[s.force_n] * 2,
            )
            bullet.stepSimulation()
            if k % SHOWN_EVERY == 0 or k == n:
                self._note(stage)
            if stage == "approach" and (hit := self._collided()) is not None:
                self._note(stage)
                return hit
        return None

    def _collided(self) -> Verdict | None:
        forces: dict[int, float] = {}
        for p in self._bullet.getContactPoints(self._hand):
            forces[p[2]] = forces.get(p[2], 0.0) + p[9]
        hit = max(forces, key=lambda body: forces[body], default=None)
        if hit is None or forces[hit] <= STOP_N:
            return None
        if hit == self._plane:
            return "collided with the ground"
        return "collided with the target" if hit == self._target else "collided with a neighbour"

    def _finger_forces(self) -> tuple[float, float]:
        """Force of each finger on the target [N]; 0 where they do not touch."""
        if self._target < 0:
            return 0.0, 0.0
        left, right = (
            sum(p[9] for p in self._bullet.getContactPoints(self._hand, self._target, link)) for link in (_LEFT, _RIGHT)
        )
        return left, right

    def _com_in_palm(self) -> Float:
        """The target's centre of mass in the palm's frame (3,) [m]."""
        position, quat = self._bullet.getLinkState(self._hand, _Z)[:2]
        R = np.array(pybullet.getMatrixFromQuaternion(quat)).reshape(3, 3)
        return R.T @ (np.array(self._bullet.getBasePositionAndOrientation(self._target)[0]) - np.array(position))

    def _height(self) -> float:
        return self._bullet.getBasePositionAndOrientation(self._target)[0][2]

    def _note(self, stage: str) -> None:
        """Add a moment to the path; the world is only read, so that recording changes nothing."""
        self._progress.checkpoint(f"Grasping: {stage}")
        bullet = self._bullet
        left, right = (bullet.getJointState(self._hand, link)[0] for link in (_LEFT, _RIGHT))
        hand = bullet.getLinkState(self._hand, _Z)[:2]
        poses = {i: bullet.getBasePositionAndOrientation(body) for i, body in self._ids.items()}
        gap_m = self._settings.opening_m - left - right
        contacts = tuple(
            GraspContact(self._instance_of.get(p[2]), np.array(p[6]), p[9])
            for p in bullet.getContactPoints(self._hand)
            if p[9] > 0.0
        )
        self._frames.append((stage, hand, gap_m, poses, self._finger_forces(), contacts))

    def _path(self, verdict: Verdict) -> GraspPath:
        palm_z = transform(np.eye(3), [0.0, 0.0, -(PALM_FRONT_M - PALM_M[2] / 2)])
        return GraspPath(
            verdict,
            tuple(frame[0] for frame in self._frames),
            np.array([_transform(*frame[1]) @ palm_z for frame in self._frames]),
            np.array([frame[2] for frame in self._frames]),
            {
                i: np.array([_transform(*frame[3][i]) for frame in self._frames]) @ body.collider.T_com_obj
                for i, body in self._bodies.items()
            },
            np.array([frame[4] for frame in self._frames]),
            tuple(frame[5] for frame in self._frames),
        )


def _transform(position: Sequence[float], quat_xyzw: Sequence[float]) -> Float:
    return transform(np.array(pybullet.getMatrixFromQuaternion(quat_xyzw)).reshape(3, 3), position)


def _quat_xyzw(T: Float) -> tuple[float, float, float, float]:
    w, x, y, z = quat_wxyz(T[:3, :3]).tolist()
    return x, y, z, w
