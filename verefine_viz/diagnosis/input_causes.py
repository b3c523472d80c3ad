"""Causes in the method's input: an undeclared symmetry, poses in metres, the depth image, the mask."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion

from verefine_viz.calibration.depth_shift import AGREES
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.causes import Cause
from verefine_viz.core.errors import NoSupportError
from verefine_viz.core.finding import Finding
from verefine_viz.core.geometry import transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Target
from verefine_viz.diagnosis.case import Case
from verefine_viz.diagnosis.number_words import instead
from verefine_viz.diagnosis.signs import ground_truth_is_unfit
from verefine_viz.diagnosis.symmetry import undeclared_turn
from verefine_viz.observation.normals import estimate_normals
from verefine_viz.observation.observed_frame import segment_cloud
from verefine_viz.observation.support_plane import Gravity, find_support
from verefine_viz.scenes.frame_surroundings import with_surroundings

MISSING_SHARE = 0.4
"""Share of the object's pixels without depth that is worth a re-run."""
LEAK_SHARE = 0.12
"""Share of the mask beside the object that is worth a re-run."""
MISS_SHARE = 0.25
"""Share of the object beside the mask that is worth a re-run."""
BORDER_PX = 2
"""Accuracy that masks can be expected to have [px]."""
ON_SURFACE_M = 0.010
"""Distance from the true surface that noise of sensors and of annotated poses explains [m]."""
UNITS = {"metres": 1000.0, "centimetres": 10.0}
"""Factor that brings a translation in this unit to millimetres."""


def ground_truth(case: Case) -> Finding | None:
    """Finds ground truth off the measured surface while the answer explains the image: axes or frame differ."""
    outline, off = case.frame.outline(case.instance_id), case.frame.registration
    if case.answer is None or not case.lab.traits.verifies or off.is_off:
        return None
    right, wrong = (case.lab.verifier.score(case.target, T[None])[0] for T in (case.T_gt, case.answer.T_cam_obj))
    if not ground_truth_is_unfit(wrong, right):
        return None
    observed_m = case.target.observation.depth_m
    measured = outline & (observed_m > 0)
    apart_m = np.abs(observed_m[measured] - case.frame.depth_m[measured])
    agreement = float(np.mean(apart_m < ON_SURFACE_M)) if len(apart_m) else 0.0
    if agreement > AGREES:  # The object is there, and the mask is that of something else.
        return None
    return Finding(
        Cause.GROUND_TRUTH,
        f"The ground truth of the {case.name} does not fit its image: it scores {right.score:.2f}, and on "
        f"{agreement:.0%} of its pixels the measured depth is there; the answer scores {wrong.score:.2f}. The mesh may "
        "have other axes than the poses are about (Y up, mirrored), or the poses another frame.",
        {
            "score_of_ground_truth": right.score,
            "score": wrong.score,
            "agreement": agreement,
            "error": case.error,
        },
        True,
    )


def symmetric(case: Case) -> Finding | None:
    """Finds that the object has the same shape at the estimate, by a symmetry that its model does not declare."""
    if case.answer is None:
        return None
    turn = undeclared_turn(case.target.model, case.answer.T_cam_obj, case.T_gt, case.threshold)
    return None if turn is None else turn.finding(case.name)


def unit(case: Case) -> Finding | None:
    """Finds initial poses written in metres or centimetres; decided by a re-run with them in millimetres."""
    diameter_m, given = case.target.model.diameter_m, case.target.instance.hypotheses
    units = [likely_unit(h.T_cam_obj, case.T_gt, diameter_m) for h in given]
    wrong = [name for name in units if name]
    if not wrong:
        return None
    poses = [_to_millimetres(h.T_cam_obj, name) for h, name in zip(given, units, strict=True)]
    again = case.rerun("initial poses in millimetres", case.with_pool(*poses))
    whose = "The translation of the only hypothesis"
    if len(units) > 1:
        whose = f"The translation{'s' * (len(wrong) > 1)} of {len(wrong)} of {len(units)} hypotheses"
    factor = UNITS[wrong[0]]
    return Finding(
        Cause.UNIT,
        f"{whose} of the {case.name} look{'s' * (len(wrong) == 1)} like {wrong[0]}, where millimetres are expected; "
        f"with {factor:g} × t {instead(again.error, case.error)}.",
        {
            "hypotheses": float(len(units)),
            "hypotheses_in_another_unit": float(len(wrong)),
            "factor": factor,
            "error": case.error,
            "error_repaired": again.error,
        },
        again.repaired,
        again.what,
    )


def likely_unit(T_est: Float, T_gt: Float, diameter_m: float) -> str:
    """The unit that the translation of a pose (4, 4) seems to have, where it would lie on the object with it; else "".

    A pose nearer to ground truth than the diameter is taken as it is.
    """
    t, t_gt = T_est[:3, 3], T_gt[:3, 3]
    if np.linalg.norm(t - t_gt) < diameter_m:
        return ""
    return next((unit for unit, factor in UNITS.items() if np.linalg.norm(factor * t - t_gt) < diameter_m), "")


def _to_millimetres(T_est: Float, unit: str) -> Float:
    return transform(T_est[:3, :3], UNITS.get(unit, 1.0) * T_est[:3, 3])


def depth(case: Case) -> Finding | None:
    """Finds depth missing on the object, beside it, or of another scale; decided by a re-run with it corrected."""
    off = case.frame.registration
    if off.is_off:
        return _unregistered(case)
    outline = case.frame.outline(case.instance_id)
    if not outline.any():
        return None
    empty = outline & (case.target.observation.depth_m <= 0)
    missing = float(np.count_nonzero(empty) / np.count_nonzero(outline))
    if missing < MISSING_SHARE:
        return None
    depth_m = np.where(empty, case.frame.depth_m, case.target.observation.depth_m)
    again = case.rerun("depth filled in", _with_depth(case, depth_m, keep_support=True))
    then = f"with it {instead(again.error, case.error)}"
    return Finding(
        Cause.DEPTH,
        f"{missing:.0%} of the {case.name}'s pixels have no depth; {then}.",
        {"missing_share": missing, "error": case.error, "error_repaired": again.error},
        again.repaired,
        again.what,
    )


def _unregistered(case: Case) -> Finding:
    off = case.frame.registration
    again = case.rerun("depth put right", _with_depth(case, case.frame.observed_m, keep_support=False))
    right, down = off.shift_px
    if abs(off.scale - 1) > 0:
        how = f"Depth is {off.scale:.3g} times what it should be"
    else:
        how = f"The depth image lies {abs(right)} px to the {'right' if right > 0 else 'left'}"
        how += f" and {abs(down)} px {'below' if down > 0 else 'above'} the mask" if down else " of the mask"
    then = f"put right, {instead(again.error, case.error)}"
    evidence = {
        "shift_right_px": float(right),
        "shift_down_px": float(down),
        "scale": off.scale,
        "agreement": off.agreement,
        "agreement_repaired": off.best_agreement,
        "error": case.error,
        "error_repaired": again.error,
    }
    return Finding(Cause.DEPTH, f"{how}; {then}.", evidence, again.repaired, again.what)


def mask(case: Case) -> Finding | None:
    """Finds a mask that covers something else, or not all of the object; decided by a re-run with the true outline."""
    outline, given = case.frame.outline(case.instance_id), case.target.instance.mask
    if not outline.any():
        return None
    leak = _share_outside(given, _grown(outline))
    miss = _share_outside(_shrunk(outline), given)
    if leak < LEAK_SHARE and miss < MISS_SHARE:
        return None
    again = case.rerun("true mask", _with_mask(case, outline))
    wrong = []
    if leak >= LEAK_SHARE:
        wrong.append(f"{leak:.0%} of the mask lies beside the {case.name}")
    if miss >= MISS_SHARE:
        wrong.append(f"the mask leaves out {miss:.0%} of the {case.name}")
    what = " and ".join(wrong)
    return Finding(
        Cause.MASK,
        f"{what[0].upper()}{what[1:]}; with the true outline {instead(again.error, case.error)}.",
        {"leak_share": leak, "miss_share": miss, "error": case.error, "error_repaired": again.error},
        again.repaired,
        again.what,
    )


INPUT_TESTS: tuple[Callable[[Case], Finding | None], ...] = (ground_truth, symmetric, unit, depth, mask)


def _with_depth(case: Case, depth_m: NDArray[np.floating], keep_support: bool) -> Target:
    """The target with another depth image and everything derived from it."""
    observation, instance = case.target.observation, case.target.instance
    depth = np.ascontiguousarray(depth_m, dtype=np.float32)
    normals = estimate_normals(depth, observation.camera)
    changed = replace(observation, depth_m=depth, normals_cam=normals)
    if not keep_support:
        changed = _with_support_of(changed, case)
    settings = case.lab.toolbox.session.scene
    cloud = segment_cloud(depth, observation.camera, instance.mask, settings.cloud_points, settings.seed)
    return Target(changed, replace(instance, points_cam=cloud), case.target.model)


def _with_support_of(observation: Observation, case: Case) -> Observation:
    """The observation with the plane and surroundings that its own depth shows, and gravity as it was known before."""
    before = case.target.observation.support
    session = case.lab.toolbox.session
    gravity: Gravity = "plane"
    if before is not None and before.gravity_source != "plane":
        x, y, z = (-before.T_world_cam[2, :3]).tolist()
        gravity = (x, y, z)
    try:
        support = find_support(
            observation.depth_m, observation.camera, observation.object_mask, gravity, None, session.scene.seed
        )
    except NoSupportError as error:
        return replace(observation, support=None, support_note=str(error))
    return with_surroundings(replace(observation, support=support), case.trace.problem.frame, session.physics)[0]


def _with_mask(case: Case, outline: Mask) -> Target:
    observation, instance = case.target.observation, case.target.instance
    settings = case.lab.toolbox.session.scene
    union = (observation.object_mask & ~instance.mask) | outline
    cloud = segment_cloud(observation.depth_m, observation.camera, outline, settings.cloud_points, settings.seed)
    changed = replace(instance, mask=outline, points_cam=cloud)
    return Target(replace(observation, object_mask=union), changed, case.target.model)


def _share_outside(inner: Mask, outer: Mask) -> float:
    """Share of a mask that lies outside of another, in [0, 1]."""
    return float(np.count_nonzero(inner & ~outer) / max(np.count_nonzero(inner), 1))


def _grown(m: Mask) -> Mask:
    return np.asarray(binary_dilation(m, iterations=BORDER_PX), dtype=bool)


def _shrunk(m: Mask) -> Mask:
    return np.asarray(binary_erosion(m, iterations=BORDER_PX), dtype=bool)
