"""Causes that lie in the scene around the object: a misplaced neighbour, the plane, colliders, the simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.finding import Finding
from verefine_viz.core.geometry import angle_between, apply
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Hypothesis, Placed
from verefine_viz.core.records import Iteration
from verefine_viz.diagnosis.case import Case, Rerun
from verefine_viz.diagnosis.number_words import instead
from verefine_viz.evaluation.pose_errors import ErrorOf
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.scenes.frame_surroundings import with_surroundings

TILT_DEG = 4.0
"""Tilt of a plane that is not worth a re-run [deg]."""
OFF_M = 0.008
"""Distance of a plane from the objects' bases that is not worth a re-run [m]."""
GRAVITY_DEG = 12.0
"""Angle of gravity to the plane's normal that is worth a re-run [deg]."""
COARSE_SHARE = 0.03
"""Distance of a collider from its mesh, as a share of the diameter, that is worth a re-run."""
PUSH = 0.02
"""Least error that a simulation adds if it pushes something away (share of the diameter)."""


def neighbour(case: Case) -> Finding | None:
    """Finds a misplaced object that was placed before; decided by a re-run with all others at ground truth."""
    wrong = [(error, placed) for placed in case.placed if (error := _error_of(case, placed)) >= case.threshold]
    if not wrong:
        return None
    error, worst = max(wrong, key=lambda pair: pair[0])
    again = _among_true_neighbours(case)
    return Finding(
        Cause.NEIGHBOUR,
        f"The {worst.model.name} was placed before the {case.name} and was wrong by {error:.0%} of its diameter; with "
        f"it in the right place {instead(again.error, case.error)}.",
        {
            "neighbour": float(worst.instance_id),
            "neighbour_error": error,
            "error": case.error,
            "error_repaired": again.error,
        },
        again.repaired,
        again.what,
    )


def plane(case: Case) -> Finding | None:
    """The support plane or gravity is wrong, or unknown; decided by a re-run with the true one.

    Surroundings have surfaces of their own: of the plane they take only which way is up.
    """
    true, given = case.frame.support, case.target.observation.support
    if true is None or not case.lab.physics.enabled:
        return None
    tilt_deg, gravity_deg, off_m = _off(given, true, case.at_gt) if given is not None else (0.0, 0.0, 0.0)
    is_under = given is not None and (given.surroundings is not None or (tilt_deg < TILT_DEG and abs(off_m) < OFF_M))
    if is_under and gravity_deg < GRAVITY_DEG:
        return None
    observation = replace(case.target.observation, support=true)
    physics = case.lab.toolbox.session.physics
    target = replace(case.target, observation=with_surroundings(observation, case.trace.problem.frame, physics)[0])
    again = case.rerun("true plane", target)
    if given is None:
        sentence = f"No support plane was found, so nothing was simulated; with it {instead(again.error, case.error)}."
        return Finding(
            Cause.PLANE, sentence, {"error": case.error, "error_repaired": again.error}, again.repaired, again.what
        )
    where = f"{abs(off_m) * 1e3:.0f} mm too {'high' if off_m > 0 else 'low'} under the {case.name}"
    if tilt_deg >= TILT_DEG:
        where += f" and tilted by {tilt_deg:.0f}°"
    what = f"The support plane is {where}"
    if gravity_deg >= GRAVITY_DEG and gravity_deg > tilt_deg + TILT_DEG:
        what = f"Gravity is off by {gravity_deg:.0f}°"
    return Finding(
        Cause.PLANE,
        f"{what}; with the true one {instead(again.error, case.error)}.",
        {
            "plane_too_high_mm": off_m * 1e3,
            "plane_tilt_deg": tilt_deg,
            "gravity_off_deg": gravity_deg,
            "error": case.error,
            "error_repaired": again.error,
        },
        again.repaired,
        again.what,
    )


def collider(case: Case) -> Finding | None:
    """Finds a simulated solid that is far from its mesh; decided by a re-run with convex parts instead of a hull."""
    simulator = case.lab.simulator
    if not isinstance(simulator, BulletSimulator) or case.lab.physics.collider != "hull":
        return None
    if case.target.observation.support is None:
        return None
    models = [case.target.model, *(p.model for p in case.placed)]
    coarse = [
        (deviation_m, model)
        for model in models
        if (deviation_m := simulator.collider(model).deviation_m) > COARSE_SHARE * model.diameter_m
    ]
    if not coarse:
        return None
    finer = case.lab.simulator_with(structs.replace(case.lab.physics, collider="decomposition"))
    again = case.rerun("finer colliders", method=case.lab.method(finer))
    deviation_m, model = max(coarse, key=lambda pair: pair[0])
    return Finding(
        Cause.COLLIDER,
        f"Physics takes the {model.name} for its hull, which is {deviation_m * 1e3:.0f} mm from the mesh at worst; "
        f"with convex parts {instead(again.error, case.error)}.",
        {"deviation_mm": deviation_m * 1e3, "error": case.error, "error_repaired": again.error},
        again.repaired,
        again.what,
    )


def simulation(case: Case) -> Finding | None:
    """Finds that simulating moved the object away; decided by a re-run without physics."""
    pushes = [(push, i) for i in case.own if (push := _push(case, i)) is not None and push >= PUSH]
    if not pushes:
        return None
    # Pushes of the hypothesis that won count rather than those of others.
    of_winner = [(push, i) for push, i in pushes if _is_of_winner(case, i)]
    push, worst = max(of_winner or pushes, key=lambda pair: pair[0])
    again = case.rerun("no physics", method=case.lab.method(None))
    before, after = _moved(worst)
    mm = 1e3 * float(np.linalg.norm(after[:3, 3] - before[:3, 3]))
    deg = float(np.rad2deg(angle_between(before[:3, :3], after[:3, :3])))
    drift = _drift(case)
    alone = _stands_on(case)
    why = f", alone though it stands on the {alone}" if alone else ""
    which = "" if of_winner else f"hypothesis {worst.arm + 1} of "
    shares = f"from {case.error_of(before):.0%} to {case.error_of(after):.0%} of its diameter off"
    evidence = {
        "iteration": float(worst.index),
        "moved_mm": mm,
        "turned_deg": deg,
        "error_added": push,
        "error": case.error,
        "error_repaired": again.error,
    }
    if drift is not None:
        evidence["error_of_simulated_ground_truth"] = drift
    return Finding(
        Cause.SIMULATION,
        f"In iteration {worst.index} the simulation moved {which}the {case.name} by {mm:.0f} mm and {deg:.0f}°{why}, "
        f"{shares}; without physics {instead(again.error, case.error)}.",
        evidence,
        again.repaired,
        again.what,
    )


def _among_true_neighbours(case: Case) -> Rerun:
    """Re-run with objects placed before at ground truth; objects solved together start there."""
    if not case.group:
        return case.rerun("neighbours at ground truth", fixed=case.placed_at_gt)
    pools = {
        p.instance_id: [Hypothesis(p.T_cam_obj, 1.0, "ground truth")]
        for p in case.placed_at_gt
        if p.instance_id in case.group
    }
    return case.rerun_together("neighbours start at ground truth", pools)


def _error_of(case: Case, placed: Placed) -> float:
    """Error of another object as it was placed; 0 without ground truth."""
    at_gt = case.frame.placed.get(placed.instance_id)
    return 0.0 if at_gt is None else ErrorOf(placed.model, at_gt.T_cam_obj)(placed.T_cam_obj)


def _off(given: Support, true: Support, placed: Placed) -> tuple[float, float, float]:
    """Tilt of the plane [deg], of gravity [deg], and how much too high the plane is below the object [m]."""
    normal, true_normal = _normal_cam(given), _normal_cam(true)
    up = given.T_world_cam[2, :3]
    middle = placed.T_cam_obj[:3, 3]
    above, true_above = (float(apply(s.T_world_cam, middle[None])[0] @ s.normal_world) for s in (given, true))
    return _angle_deg(normal, true_normal), _angle_deg(up, true_normal), true_above - above


def _normal_cam(support: Support) -> Float:
    return support.T_world_cam[:3, :3].T @ support.normal_world


def _angle_deg(a: Float, b: Float) -> float:
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def _moved(iteration: Iteration) -> tuple[Float, Float]:
    """The poses before and after the simulation of an iteration."""
    stages = [s.name for s in iteration.stages]
    k = stages.index("simulated")
    return iteration.stages[k - 1].T_cam_obj, iteration.stages[k].T_cam_obj


def _is_of_winner(case: Case, iteration: Iteration) -> bool:
    return case.answer is None or iteration.arm == case.answer.arm


def _push(case: Case, iteration: Iteration) -> float | None:
    """Error that the simulation of an iteration added; None where nothing was simulated."""
    if iteration.stage("simulated") is None:
        return None
    before, after = _moved(iteration)
    return case.error_of(after) - case.error_of(before)


def _drift(case: Case) -> float | None:
    """How far one simulation takes the object from ground truth, as a share of the diameter; None without physics."""
    simulator, support = case.lab.simulator, case.target.observation.support
    if simulator is None or support is None:
        return None
    path = simulator.settle(case.at_gt, case.placed_at_gt, support, case.lab.physics.steps)
    return case.error_of(path.T_cam_obj)


def _stands_on(case: Case) -> str:
    """Words for objects below this one where the method had placed nothing; empty where there are none."""
    graph = case.trace.problem.dependencies
    if case.placed or graph is None:
        return ""
    supporting = [e.first for e in graph.edges if e.kind == "support" and e.second == case.instance_id]
    names = [case.trace.problem.target(i).model.name for i in supporting]
    return " and the ".join(names)


WORLD_TESTS: tuple[Callable[[Case], Finding | None], ...] = (plane, collider)
"""Tests of the input of physics."""
