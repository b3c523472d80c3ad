"""Made-up scenes in which exactly one thing is broken: a generator for every cause that a diagnosis can name.

Everything that is not broken on purpose is as it should be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tests.made_up_frames import (
    Broken,
    Depth,
    Thing,
    Z,
    broken_by,
    comes_right,
    frame_of,
    leaning,
    level,
    model,
    moved,
    near,
    on_edge,
    session_of,
    small_carton,
    standing,
)
from verefine_viz.core.arrays import Mask
from verefine_viz.core.causes import Cause
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.problem import Placed
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.diagnosis.case import sampled_again
from verefine_viz.diagnosis.diagnose import Diagnosis, diagnose
from verefine_viz.evaluation.pose_errors import ErrorOf
from verefine_viz.physics.simulator import BulletSimulator, settle_to_rest
from verefine_viz.scenes.demo_layout import LAYOUT_FRAME, Viewpoint


def bad_pool(rng: np.random.Generator) -> Broken:
    """All initial poses are upside down or on a side, and beside the object."""
    m = model(str(rng.choice(["duck", "mug", "jug"])))
    T = standing(m, rng)
    poses = []
    for _ in range(4):
        x, y, _z = 40 * level(rng.uniform(0, 2 * np.pi))
        poses.append(moved(T, level(rng.uniform(0, 2 * np.pi)), rng.uniform(95, 165), (x, y, 25)))
    return broken_by(Cause.POOL, frame_of([Thing(m, T, tuple(poses))], rng), session_of(iterations=3))


def pool_in_metres(rng: np.random.Generator) -> Broken:
    """Good initial poses, their translations in metres or centimetres where millimetres are expected."""
    m = model(str(rng.choice(["duck", "mug", "jug"])))
    T = standing(m, rng)
    factor = float(rng.choice([1e-3, 0.1]))
    problem = frame_of([Thing(m, T, near(T, rng, 2, 10, 10))], rng)
    (instance,) = problem.instances
    poses = [transform(h.T_cam_obj[:3, :3], factor * h.T_cam_obj[:3, 3]) for h in instance.hypotheses]
    pool = tuple(replace(h, T_cam_obj=pose) for h, pose in zip(instance.hypotheses, poses, strict=True))
    spoilt = replace(problem, instances=(replace(instance, hypotheses=pool),))
    return broken_by(Cause.UNIT, spoilt, session_of())


def empty_pool(rng: np.random.Generator) -> Broken:
    """Nobody gives an initial pose."""
    m = model(str(rng.choice(["duck", "mug", "jug"])))
    return broken_by(Cause.NO_HYPOTHESIS, frame_of([Thing(m, standing(m, rng), ())], rng), session_of(iterations=3))


def straying_refiner(rng: np.random.Generator) -> Broken:
    """A square carton, turned by a little more than half of a quarter: ICP turns it the wrong way."""
    m = model("carton")
    T = standing(m, rng)
    sign = rng.choice([-1, 1])
    poses = [moved(T, Z, sign * rng.uniform(55, 62), (*rng.uniform(-4, 4, 2), 3)) for _ in range(3)]
    return broken_by(Cause.REFINER, frame_of([Thing(m, T, tuple(poses))], rng), session_of())


def toppling(rng: np.random.Generator) -> Broken:
    """Initial poses that lean further than the object can stand, and a simulation long enough to let it fall.

    Without physics the refiner puts it upright.
    """
    while True:
        m = model(str(rng.choice(["carton", "jug"])))
        T = standing(m, rng)
        poses = [
            on_edge(m, moved(T, level(rng.uniform(0, 2 * np.pi)), rng.uniform(36, 44), (0, 0, 0))) for _ in range(2)
        ]
        session = session_of(iterations=3, physics={"steps": 30})
        broken = broken_by(Cause.SIMULATION, frame_of([Thing(m, T, tuple(poses))], rng), session)
        if comes_right(broken.toolbox.restarted({"physics": {"enabled": False}}), broken.problem):
            return broken


def glass_handle(rng: np.random.Generator) -> Broken:
    """The jug's handle is of glass: depth sensor and detector see through it, and a hidden handle scores higher."""
    m = model("jug")
    T = standing(m, rng, yaw_deg=float(rng.uniform(-140, -10)))
    centre = np.array([-0.0251, 0, 0])
    poses = []
    for deg in (8, 60, 125, -80, 165):
        turn = axis_angle(Z, np.deg2rad(deg + rng.uniform(-5, 5)))
        pivot = apply(T, centre[None])[0]
        R = turn @ T[:3, :3]
        t = pivot - R @ centre + np.array([*rng.uniform(-4, 4, 2), 2]) * 1e-3
        poses.append(transform(R, t))
    thing = Thing(m, T, tuple(poses), seen_as=model("jug without handle"))
    return broken_by(Cause.SCORE, frame_of([thing], rng), session_of())


def hidden_handle(rng: np.random.Generator) -> Broken:
    """The jug's handle is behind its body, and all initial poses have it elsewhere behind the body."""
    m = model("jug")
    T = standing(m, rng, 0.0, yaw_deg=90 + float(rng.uniform(12, 15)))
    pivot = apply(T, np.array([[-0.0251, 0, 0]]))[0]
    poses = []
    for _ in range(2):
        # The body has 48 sides: turned by four of them it is the same.
        turn = axis_angle(Z, np.deg2rad(-30))
        poses.append(transform(turn @ T[:3, :3], pivot + turn @ (T[:3, 3] - pivot) + rng.uniform(-3, 3, 3) * 1e-3))
    session = session_of(physics={"enabled": False})
    problem = frame_of([Thing(m, T, tuple(poses))], rng, Viewpoint(elevation_deg=18, distance_m=0.52))
    return broken_by(Cause.AMBIGUOUS, problem, session)


def starving(rng: np.random.Generator) -> Broken:
    """Four initial poses fit well and are a quarter turn off; the fifth is right but for some degrees."""
    m = model("carton")
    T = standing(m, rng)
    poses = [moved(T, Z, deg, (*rng.uniform(-2, 2, 2), 0)) for deg in (90, -90, 87, 93)]
    poses += near(T, rng, 1, 8, 8)
    session = session_of(iterations=2, method={"exploration": 0.05})
    return broken_by(Cause.ARM_STARVED, frame_of([Thing(m, T, tuple(poses))], rng), session)


def short_of_time(rng: np.random.Generator) -> Broken:
    """A start from which the refiner gets home, but not in the single call of two inner iterations that it has."""
    while True:
        m = model(str(rng.choice(["duck", "mug", "jug"])))
        T = standing(m, rng)
        start = near(T, rng, 1, rng.uniform(15, 20), rng.uniform(22, 28))
        problem = frame_of([Thing(m, T, start)], rng)
        session = session_of(str(rng.choice(["sir", "rir"])), 1, icp={"max_iterations": 2}, physics={"enabled": False})
        broken = broken_by(Cause.BUDGET, problem, session)
        if _gets_home(broken):
            return broken


def _gets_home(broken: Broken, calls: int = 8) -> bool:
    (target,) = broken.problem.targets
    T, T_true = target.instance.hypotheses[0].T_cam_obj, target.instance.T_cam_obj_gt
    assert T_true is not None
    for _ in range(calls):
        T = broken.toolbox.refiner.refine(target, T)
    return ErrorOf(target.model, T_true)(T) < 0.03


def tilted_plane(rng: np.random.Generator) -> Broken:
    """The support plane that was found is not the table: it is tilted and too high."""
    m = model(str(rng.choice(["carton", "jug", "mug"])))
    T = standing(m, rng)
    thing = Thing(m, T, near(T, rng, 1, 8, 8))
    tilt, up_m, heading = rng.uniform(25, 40), rng.uniform(0.0, 0.03), rng.uniform(0, 2 * np.pi)

    problem = frame_of([thing], rng, spoil_support=lambda support: leaning(support, level(heading), tilt, -up_m))
    return broken_by(Cause.PLANE, problem, session_of("pir", 4, physics={"steps": 20}))


def filled_bowl(rng: np.random.Generator) -> Broken:
    """A small carton in a bowl that physics takes for its hull."""
    bowl, m = model("bowl"), small_carton()
    T_bowl = standing(bowl, rng, 0.02)
    above = transform(axis_angle(Z, rng.uniform(0, 2 * np.pi)), T_bowl[:3, 3] + [*rng.uniform(-0.005, 0.005, 2), 0.05])
    resting = settle_to_rest(
        BulletSimulator(PhysicsSettings()), Placed(1, m, above), [Placed(0, bowl, T_bowl)], LAYOUT_FRAME
    )
    T = resting.T_cam_obj
    things = [Thing(bowl, T_bowl, near(T_bowl, rng, 1, 4, 4)), Thing(m, T, near(T, rng, 2, 12, 8))]
    session = session_of(
        "vf_breadth", 3, physics={"collider": "hull", "steps": 40}, dependency={"order": (("#0", "#1"),)}
    )
    view = Viewpoint(elevation_deg=58, distance_m=0.5)
    return broken_by(Cause.COLLIDER, frame_of(things, rng, view), session, 1)


def bad_mask(rng: np.random.Generator) -> Broken:
    """The mask swallows the box beside the object, or covers a part of the object only."""
    while True:
        m, beside = model(str(rng.choice(["mug", "duck", "jug"]))), model("cereal")
        T = standing(m, rng, 0.01)
        T[0, 3] -= 0.05
        T_beside = standing(beside, rng, yaw_deg=float(rng.uniform(60, 120)))
        T_beside[:2, 3] = T[:2, 3] + [0.12, rng.uniform(0.0, 0.04)]
        things = [Thing(m, T, near(T, rng, 2, 18, 22)), Thing(beside, T_beside, is_asked_for=False)]
        spoil = (_leaking, _cut_to(rng.uniform(0.10, 0.2)))[rng.integers(2)]
        broken = broken_by(Cause.MASK, frame_of(things, rng, spoil_mask=spoil), session_of())
        if comes_right(broken.toolbox, frame_of(things, np.random.default_rng(0))):
            return broken


def _leaking(k: int, masks: Sequence[Mask]) -> Mask:
    return masks[k] | masks[1]


def _cut_to(part: float) -> Callable[[int, Sequence[Mask]], Mask]:
    def cut(k: int, masks: Sequence[Mask]) -> Mask:
        v, u = np.nonzero(masks[k])
        kept = np.zeros_like(masks[k])
        first = np.argsort(u - 0.4 * v)[: int(part * len(v))]
        kept[v[first], u[first]] = True
        return kept

    return cut


def bad_depth(rng: np.random.Generator) -> Broken:
    """Depth is missing on most of the object, or shifted, or in a unit that is a little wrong."""
    while True:
        m = model(str(rng.choice(["mug", "duck", "jug"])))
        T = standing(m, rng)
        thing = Thing(m, T, near(T, rng, 2, 15, 20))
        part, scale = rng.uniform(0.02, 0.05), float(rng.uniform(1.06, 1.12))
        shift = int(rng.choice([-1, 1]) * rng.integers(16, 24))
        spoil = (_mirroring(part), _shifted(shift), _scaled(scale))[rng.integers(3)]
        broken = broken_by(Cause.DEPTH, frame_of([thing], rng, spoil_depth=spoil), session_of())
        if comes_right(broken.toolbox, frame_of([thing], np.random.default_rng(0))):
            return broken


def _mirroring(part: float) -> Callable[[Depth, Sequence[Mask]], Depth]:
    def lose(depth_m: Depth, masks: Sequence[Mask]) -> Depth:
        v, u = np.nonzero(masks[0])
        lost = np.argsort(u + 0.5 * v)[int(part * len(v)) :]
        out = depth_m.copy()
        out[v[lost], u[lost]] = 0
        return out

    return lose


def _scaled(scale: float) -> Callable[[Depth, Sequence[Mask]], Depth]:
    return lambda depth_m, masks: depth_m * np.float32(scale)


def _shifted(shift_px: int) -> Callable[[Depth, Sequence[Mask]], Depth]:
    def shift(depth_m: Depth, masks: Sequence[Mask]) -> Depth:
        out = np.zeros_like(depth_m)
        a, b = max(shift_px, 0), min(shift_px, 0)
        out[:, a : 320 + b] = depth_m[:, -b : 320 - a]
        return out

    return shift


def undeclared_symmetry(rng: np.random.Generator) -> Broken:
    """The model declares no symmetry, and all initial poses are turned by one."""
    name = str(rng.choice(["can", "block", "cereal", "bottle", "bracket"]))
    full, m = model(name), model(name, symmetric=False)
    T = standing(m, rng)
    turns = [
        S
        for S in full.symmetries
        if np.trace(S[:3, :3]) < 1.0 and np.linalg.norm(S @ [0, 0, 0.05, 1] - [0, 0, 0.05, 1]) < 1
    ]
    poses = []
    for _ in range(2):
        S = turns[rng.integers(len(turns))]
        poses += [P @ S for P in near(T, rng, 1, 5, 5)]
    return broken_by(Cause.SYMMETRIC, frame_of([Thing(m, T, tuple(poses))], rng), session_of())


def misplaced_neighbour(rng: np.random.Generator) -> Broken:
    """A mirroring can gives no depth, stays where its estimator put it, and that is where the next object is.

    That decides, not which of the observed points are used.
    """
    while True:
        broken = _misplaced_neighbour(rng)
        if not _right_by_chance(broken, 3):
            return broken


def _right_by_chance(broken: Broken, n: int) -> int:
    """In how many of ``n`` runs on other samples of the observed points it comes out right."""
    scene, problem = broken.toolbox.session.scene, broken.problem
    again = [
        replace(problem, instances=tuple(sampled_again(t, scene, k).instance for t in problem.targets))
        for k in range(1, n + 1)
    ]
    return sum(comes_right(broken.toolbox, other, broken.instance_id) for other in again)


def _misplaced_neighbour(rng: np.random.Generator) -> Broken:
    other, m = model(str(rng.choice(["can", "bottle"]))), model(str(rng.choice(["duck", "carton"])))
    T = standing(m, rng, 0.01)
    T[0, 3] += 0.05
    T_other = standing(other, rng, 0.01)
    T_other[0, 3] -= 0.07
    poses = []
    for _ in range(2):
        x, y, _z = rng.uniform(0.01, 0.03) * level(rng.uniform(0, 2 * np.pi))
        poses.append(transform(T_other[:3, :3], [T[0, 3] + x, T[1, 3] + y, T_other[2, 3]]))
    things = [Thing(other, T_other, tuple(poses)), Thing(m, T, near(T, rng, 2, 18, 18))]
    session = session_of(
        "vf_breadth", 2, physics={"steps": 25}, dependency={"order": (("#0", "#1"),)},
        method={"refiner": "trimmed_icp"},
    )  # fmt: skip
    problem = frame_of(
        things, rng, Viewpoint(elevation_deg=45, distance_m=0.6),
        spoil_depth=lambda depth, masks: np.where(masks[0], np.float32(0), depth),
    )  # fmt: skip
    return broken_by(Cause.NEIGHBOUR, problem, session, 1)


def outscored(rng: np.random.Generator) -> Broken:
    """Nothing is refined: a correct pose is too far away, and one that lies aside by more scores higher."""
    m = model("carton")
    T, view = standing(m, rng, yaw_deg=float(rng.uniform(85, 95))), Viewpoint(elevation_deg=40, distance_m=0.52)
    right, _down, away = 1e3 * m.diameter_m * view.T_world_cam[:3, :3].T
    poses = [moved(T, Z, 0.0, share * way) for share, way in ((0.12, right), (rng.uniform(0.08, 0.09), away))]
    session = session_of(
        "rir", 2, method={"refiner": "identity", "exploration": 5.0}, physics={"enabled": False}, score={"tau_m": 0.01}
    )
    return broken_by(Cause.DISCARDED, frame_of([Thing(m, T, tuple(poses))], rng, view), session)


def out_of_range(rng: np.random.Generator) -> Broken:
    """All initial poses are turned further than the learned refiner was trained on, or shifted further."""
    m = model(str(rng.choice(["duck", "mug", "jug"])))
    T = standing(m, rng)
    poses = []
    for _ in range(2):
        shift_mm = (*rng.uniform(-10, 10, 2), 5)
        if rng.random() < 0.5:
            poses.append(moved(T, level(rng.uniform(0, 2 * np.pi)), rng.uniform(80, 160), shift_mm))
        else:
            aside = rng.uniform(1.0, 1.3) * 500 * m.diameter_m * level(rng.uniform(0, 2 * np.pi))
            poses.append(moved(T, level(rng.uniform(0, 2 * np.pi)), rng.uniform(65, 90), aside + 5 * Z))
    session = session_of(
        str(rng.choice(["refine", "sir", "rir"])),
        3,
        method={"refiner": str(rng.choice(["depth_net", "depth_net_icp"]))},
    )
    return broken_by(Cause.OUT_OF_RANGE, frame_of([Thing(m, T, tuple(poses))], rng), session)


def between_two_basins(rng: np.random.Generator) -> Broken:
    """Half of a quarter turn off: which way ICP turns a square carton depends on the points that it is given."""
    m = model("carton")
    session = session_of("rir", 2, physics={"enabled": False})
    while True:
        T = standing(m, rng)
        start = moved(T, Z, rng.choice([-1, 1]) * rng.uniform(40, 52), (*rng.uniform(-4, 4, 2), 3))
        broken = broken_by(Cause.UNDECIDED, frame_of([Thing(m, T, (start,))], rng), session)
        if not comes_right(broken.toolbox, broken.problem) and _right_by_chance(broken, 5) in (2, 3):
            return broken


def other_axes(rng: np.random.Generator) -> Broken:
    """Ground truth is about a mesh whose y axis looks up, the mesh at hand has z up: each sees another object there."""
    m = model(str(rng.choice(["jug", "mug"])))
    T = standing(m, rng)
    problem = frame_of([Thing(m, T, near(T, rng, 2, 10, 10))], rng)
    (instance,) = problem.instances
    assert instance.T_cam_obj_gt is not None
    y_up = transform(axis_angle(np.array([1.0, 0, 0]), rng.choice([-1, 1]) * np.pi / 2), np.zeros(3))
    spoilt = replace(problem, instances=(replace(instance, T_cam_obj_gt=instance.T_cam_obj_gt @ y_up),))
    return broken_by(Cause.GROUND_TRUTH, spoilt, session_of())


GENERATORS: dict[Cause, Callable[[np.random.Generator], Broken]] = {
    Cause.SYMMETRIC: undeclared_symmetry,
    Cause.DEPTH: bad_depth,
    Cause.MASK: bad_mask,
    Cause.NEIGHBOUR: misplaced_neighbour,
    Cause.SCORE: glass_handle,
    Cause.PLANE: tilted_plane,
    Cause.COLLIDER: filled_bowl,
    Cause.SIMULATION: toppling,
    Cause.ARM_STARVED: starving,
    Cause.BUDGET: short_of_time,
    Cause.REFINER: straying_refiner,
    Cause.POOL: bad_pool,
    Cause.NO_HYPOTHESIS: empty_pool,
    Cause.UNIT: pool_in_metres,
    Cause.AMBIGUOUS: hidden_handle,
    Cause.DISCARDED: outscored,
    Cause.UNDECIDED: between_two_basins,
    Cause.OUT_OF_RANGE: out_of_range,
    Cause.GROUND_TRUTH: other_axes,
}
"""A new one goes to the end: the place of a cause is part of its scenes' seeds."""


def broken_scene(cause: Cause, seed: int) -> Broken:
    """The ``seed``-th scene in which ``cause`` is what is broken."""
    return GENERATORS[cause](np.random.default_rng((list(GENERATORS).index(cause), seed)))


def named(broken: Broken) -> Diagnosis | None:
    """What the diagnosis says of the instance that is meant; None where it did not fail."""
    run = broken.toolbox.run(broken.problem)
    run.finish()
    found = diagnose(run, broken.toolbox)
    return next((d for d in found if d.instance_id == broken.instance_id), None)
