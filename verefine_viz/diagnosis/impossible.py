"""Answers that cannot lie where they are, which shows without ground truth: they sink into something, float or tip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.core.surroundings import SUPPORT_ID
from verefine_viz.diagnosis.causes import Cause, Finding
from verefine_viz.diagnosis.data_doubts import plane_doubt
from verefine_viz.physics.plausibility import Plausibility, plausibility
from verefine_viz.physics.proximity import Surfaces
from verefine_viz.physics.stability import IMPOSSIBLE_M


def impossible(target: Target, physics: Plausibility, labels: Mapping[int, str]) -> Finding | None:
    """That an object cannot lie in a pose; None where it can, or where only a plane that is in doubt says so.

    Args:
        target: the object.
        physics: of its pose.
        labels: names of objects, by instance.
    """
    support, into = target.observation.support, physics.penetrates
    is_of_object = into is not None and into != SUPPORT_ID
    if physics.light != "red" or support is None or (plane_doubt(support) and not is_of_object):
        return None
    sentence = physics.sentence
    if into is not None and into in labels:
        sentence = sentence.replace(f"instance {into}.", f"the {labels[into]}.")
    detail = sentence.partition(":")[0]
    if physics.penetration_mm > 1e3 * IMPOSSIBLE_M:
        detail = f"Sinks {physics.penetration_mm:.1f} mm"
    elif physics.gap_mm > 1e3 * IMPOSSIBLE_M:
        detail = f"Floats {physics.gap_mm:.1f} mm"
    return Finding(
        Cause.IMPOSSIBLE,
        f"The {labels[target.instance.instance_id]} cannot lie where its answer has it. {sentence}",
        {"penetration_mm": physics.penetration_mm, "gap_mm": physics.gap_mm},
        detail=f": {detail[0].lower()}{detail[1:]}",
    )


def impossible_answers(
    problem: Problem, poses: Sequence[Float | None], settings: PhysicsSettings, surfaces: Surfaces
) -> dict[int, Finding]:
    """Answers without ground truth that cannot be, by instance, each among all others.

    Args:
        problem: the frame.
        poses: T_cam_obj (4, 4) that answers each target, None where there is none.
        settings: of the simulator.
        surfaces: of the models, where they are cached.
    """
    support = problem.observation.support
    if support is None:
        return {}
    labels = {t.instance.instance_id: t.model.name for t in problem.targets}
    placed = {
        t.instance.instance_id: Placed(t.instance.instance_id, t.model, T)
        for t, T in zip(problem.targets, poses, strict=True)
        if T is not None
    }
    findings: dict[int, Finding] = {}
    for target in problem.targets:
        own = placed.get(target.instance.instance_id)
        if own is None or target.instance.T_cam_obj_gt is not None:
            continue
        others = [other for other in placed.values() if other is not own]
        finding = impossible(target, plausibility(own, others, support, settings, surface_of=surfaces), labels)
        if finding is not None:
            findings[own.instance_id] = finding
    return findings
