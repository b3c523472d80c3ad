"""Verifies a label, as a traffic light with reasons. A wrong label must not look verified."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.scores import PIXEL_CLASSES
from verefine_viz.evaluation.allowed_poses import AllowedPoses
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.labels.snapping import Snapped, snapped
from verefine_viz.run.refined_pose import RefinedPose
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.labels import Label, Light

WRONG_FIT, POOR_FIT = 0.45, 0.75
"""Share of the pixels with evidence that depth explains, below which a pose is wrong, or doubtful."""
FEW_SEEN, LITTLE_MEASURED = 0.3, 0.4
"""Share of the drawn object that nothing nearer hides, and that depth was measured of, below which it is doubtful."""
FAR_SHARE, FAR_DEG = 0.3, 45.0
"""Motion by snapping, as a share of the diameter, and turn, from which a person should look at the label."""
TURN_DEG, SHIFT_SHARE = 10.0, 0.05
"""Undetermined turn [deg], and shift [share of the diameter], above which a label is in doubt."""

ALIKE_SCORE = 0.02
"""Poses in which the shape nearly looks the same and whose scores differ by less look alike: of 28 objects of
YCB-Video none turned so scores 0.005 more than at the truth."""

Reason = tuple[Light, str]


def label_of(tools: Toolbox, snap: Snapped, begun: str = "placed", seconds: float = 0.0) -> Label:
    """The label of a snapped object, with its verification.

    Args:
        tools: of the session that snapped it.
        snap: the object.
        begun: where its pose began, as :attr:`~verefine_viz.scenes.labels.Label.begun`.
        seconds: what snapping took [s].
    """
    rested, instance, model = snap.refined, snap.target.instance, snap.target.model
    reasons = [*_reasons(snap)]
    lights = {light for light, _ in reasons}
    allowed, physics = rested.allowed, rested.physics
    fit_mm, measured = _residual_mm(tools, snap.target, rested.T_cam_obj)
    return Label(
        instance.instance_id,
        instance.obj_id,
        model.name,
        tuple(rested.T_cam_obj.ravel().tolist()),
        "red" if "red" in lights else "amber" if "amber" in lights else "green",
        tuple(text for light, text in sorted(reasons, key=lambda one: one[0] != "red") if light != "green"),
        score=round(float(rested.score.score), 4),
        fit_mm=round(fit_mm, 2),
        seen=round(measured, 3),
        sinks_mm=0.0 if physics is None else round(physics.penetration_mm, 2),
        undetermined_mm=0.0 if allowed is None else round(allowed.undetermined_mm, 2),
        undetermined_deg=0.0 if allowed is None else round(allowed.undetermined_deg, 1),
        begun=begun,
        refiner=tools.session.method.refiner,
        seconds=round(seconds, 2),
    )


def labelled(
    tools: Toolbox,
    observation: Observation,
    proposed: Placed,
    others: Sequence[Placed] = (),
    begun: str = "placed",
    snap: Callable[[Toolbox, Observation, Placed, Sequence[Placed]], Snapped] = snapped,
) -> Label:
    """Snap an object and verify it: what "Snap" on the page and :func:`verefine_viz.label` do.

    Args:
        tools: of the session.
        observation: the frame.
        proposed: the object with a rough pose.
        others: the other objects of the frame, where they are.
        begun: where the pose began.
        snap: what snaps it.

    Raises:
        ShapeError: the pose is not rigid, or no solid can be made of the model.
    """
    began = time.perf_counter()
    of = snap(tools, observation, proposed, others)
    return label_of(tools, of, begun, time.perf_counter() - began)


def _reasons(snap: Snapped) -> Iterator[Reason]:
    model, rested = snap.target.model, snap.refined
    yield from _of_fit(rested)
    if rested.physics is not None and rested.physics.light == "red":
        yield "red", rested.physics.sentence
    if rested.allowed is not None:
        yield from _of_allowed(rested.allowed, model, bool(snap.rivals))
    if snap.rivals and snap.rivals[0].gain > -ALIKE_SCORE:
        best = snap.rivals[0]
        yield "amber", _turned(rested.T_cam_obj, best.T_cam_obj, best.gain > ALIKE_SCORE)
    yield from _of_way(model, snap.proposed, rested.T_cam_obj)


def _of_fit(rested: RefinedPose) -> Iterator[Reason]:
    explained, missed, protruding, hidden, unknown = rested.score.counts
    evidence = explained + missed + protruding
    if evidence == 0:
        yield "red", "nothing of it is measured"
        return
    drawn, fit = max(explained + protruding + hidden + unknown, 1), explained / evidence
    if fit < POOR_FIT:
        what = "it leaves out much of what is measured" if missed > protruding else "depth sees through it"
        yield ("red" if fit < WRONG_FIT else "amber"), f"depth explains {fit:.0%}: {what}"
    if 1 - hidden / drawn < FEW_SEEN:
        yield "amber", f"{hidden / drawn:.0%} of it is hidden"
    if 1 - unknown / drawn < LITTLE_MEASURED:
        yield "amber", f"no depth on {unknown / drawn:.0%} of it"


def _of_allowed(allowed: AllowedPoses, model: ObjectModel, has_rivals: bool) -> Iterator[Reason]:
    diameter_mm = 1e3 * model.diameter_m
    for extent in sorted(allowed.extents, key=lambda one: -one.width):
        is_turn = extent.axis.kind == "turn"
        if extent.width <= (TURN_DEG if is_turn else SHIFT_SHARE * diameter_mm):
            continue
        ends = [extent.axis.moved(allowed.T_cam_obj, end) for end in (extent.low, extent.high)]
        apart_mm = max(add_s_mm(model, end, allowed.T_cam_obj) for end in ends)
        if apart_mm > SHIFT_SHARE / 2 * diameter_mm:  # A turn about a declared axis moves nothing.
            yield "amber", extent.describe()
            break
    if allowed.alike and not has_rivals:
        yield "amber", _turned(allowed.T_cam_obj, allowed.alike[0].T_cam_obj, allowed.alike[0].is_better)


def _turned(T_cam_obj: Float, T_other: Float, is_better: bool) -> str:
    angle = np.degrees(angle_between(T_other[:3, :3], T_cam_obj[:3, :3]))
    return f"a pose turned by {angle:.0f}° fits {'better' if is_better else 'as well'}"


def _of_way(model: ObjectModel, T_given: Float, T_cam_obj: Float) -> Iterator[Reason]:
    middle = model.middle_m[None]
    moved_m = float(np.linalg.norm(apply(T_cam_obj, middle) - apply(T_given, middle)))
    turns = (angle_between((T_given @ S)[:3, :3], T_cam_obj[:3, :3]) for S in model.symmetries)
    turned_deg = np.degrees(min(turns))
    if moved_m > FAR_SHARE * model.diameter_m:
        yield "amber", f"moved by {1e3 * moved_m:.0f} mm from where it was placed"
    if turned_deg > FAR_DEG:
        yield "amber", f"turned by {turned_deg:.0f}° from how it was placed"


def _residual_mm(tools: Toolbox, target: Target, T_cam_obj: Float) -> tuple[float, float]:
    """Mean distance along z of explained pixels from the model [mm], and their share of the drawn object."""
    maps = tools.verifier.maps(target, T_cam_obj)
    if maps is None:
        return 0.0, 0.0
    explained, drawn = maps.classes == 1 + PIXEL_CLASSES.index("explained"), np.count_nonzero(maps.rendered_m > 0)
    if not explained.any():
        return 0.0, 0.0
    return float(np.abs(maps.depth_difference_m[explained]).mean() * 1e3), float(explained.sum() / max(drawn, 1))
