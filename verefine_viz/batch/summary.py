"""Makes the answers of a finished run: the rows of its tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache, partial
from types import MappingProxyType
from typing import Any

import numpy as np
from msgspec import structs

from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.arrays import Float
from verefine_viz.core.doubt import texts_of
from verefine_viz.core.finding import Finding
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import Session
from verefine_viz.diagnosis.data_doubts import run_doubts
from verefine_viz.diagnosis.impossible import impossible_answers
from verefine_viz.diagnosis.lost_poses import discarded
from verefine_viz.diagnosis.measured_heights import measured_heights
from verefine_viz.evaluation.allowed_poses import AllowedPoses
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.evaluation.answer_recalls import answer_recalls
from verefine_viz.evaluation.pose_errors import add_s_mm, add_where_add_s_is_below, pose_errors
from verefine_viz.evaluation.seen_error import nearest_allowed
from verefine_viz.grasping.grasp_answer import AnswerGrasps
from verefine_viz.methods.known_methods import method_of
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.proximity import Surfaces
from verefine_viz.run.answers import left_out_answer
from verefine_viz.run.edits import never_reached
from verefine_viz.run.engine import Run
from verefine_viz.run.record import Answer, RunEnd
from verefine_viz.scenes.trace_files import NOT_CLOSED

MUCH, MUCH_SCORE = 0.03, 0.01
"""Share of the diameter, and score, that an iteration must lose to count as one where things went wrong."""


def run_end(
    run: Run,
    session: Session,
    recorded: Mapping[int, AllowedPoses] = MappingProxyType({}),
    grasps: AnswerGrasps | None = None,
    surfaces: Surfaces | None = None,
) -> RunEnd:
    """The end of a finished run of ``session``: its answers and notes.

    Args:
        run: finished.
        session: what was run.
        recorded: what the image allows beside its answers, by instance, where its recording has it already.
        grasps: what became of its answers in the gripper, where that was tried.
        surfaces: of the models, where they are cached.
    """
    problem, state = run.problem, run.final_state
    poses = [None if best is None else best.T_cam_obj for best in state.best]
    doubts = texts_of(run_doubts(problem, poses, session.score.colour_weight))
    rows = tuple(
        _object_row(problem, target, best, initial, run, session, recorded.get(target.instance.instance_id))
        for target, best, initial in zip(problem.targets, state.best, state.initial, strict=True)
    )
    simulates = session.physics.enabled and method_of(session.method.name).simulates
    heights, impossible = None, {}
    if simulates and not doubts:
        heights = measured_heights(problem, state.best)
        check = partial(plausibility, settings=session.physics, surface_of=surfaces or Surfaces())
        impossible = impossible_answers(problem, poses, check, heights)
    for own, finding in impossible.items():
        rows = tuple(with_findings(row, [finding]) if row.instance_id == own else row for row in rows)
    if doubts:
        rows = tuple(structs.replace(row, doubts=doubts) if row.status == "ok" else row for row in rows)
    if grasps is not None:
        rows = tuple(_with_grasp(row, grasps) for row in rows)
    rows += tuple(
        left_out_answer(problem.frame, one, session.method.name, session.hypotheses.seed) for one in problem.left_out
    )
    no_physics = _no_physics(problem, session)
    notes = (*problem.notes, *([no_physics] if no_physics else []))
    notes += never_reached(run.edits, session.changes, run.length)
    notes += () if heights is None else (heights.describe(),)
    notes += () if grasps is None else grasps.notes
    return RunEnd(
        answers=rows,
        notes=notes,
        doubts=doubts,
        n_unreadable=sum(one.is_unreadable for one in problem.left_out),
    )


def with_findings(row: Answer, findings: Sequence[Finding], doubts: tuple[str, ...] = ()) -> Answer:
    """The answer with findings on why it is wrong; the main one points to the iteration that did most harm."""
    main, *others = findings
    at = main.iteration if row.worst_iteration is None else row.worst_iteration
    return structs.replace(row, findings=(structs.replace(main, iteration=at), *others), doubts=doubts)


def _with_grasp(row: Answer, grasps: AnswerGrasps) -> Answer:
    pair = None if row.instance_id is None else grasps.pairs.get(row.instance_id)
    if pair is None:
        return row
    return structs.replace(row, grasp=pair.answer.verdict, grasp_ground_truth=pair.ground_truth.verdict)


def _no_physics(problem: Problem, session: Session) -> str:
    """Says why objects were not simulated although the session asks for it; empty where they were."""
    observation = problem.observation
    no_physics = session.physics.enabled and observation.support is None
    return f"no physics: {observation.support_note}" if no_physics else ""


def _object_row(
    problem: Problem,
    target: Target,
    best: Best | None,
    initial: Scores | None,
    run: Run,
    session: Session,
    allowed: AllowedPoses | None,
) -> Answer:
    iterations = [i for i in run.iterations if i.instance_id == target.instance.instance_id]
    facts = {
        **object_facts(problem, target, session.method.name),
        "seed": session.hypotheses.seed,
        "has_truth": target.instance.T_cam_obj_gt is not None,
    }
    if best is None or initial is None:
        return Answer(**facts, status="no_answer", message="no hypothesis to start from")
    allowed = allowed or allowed_poses(run.final_verifier, target, best.T_cam_obj, (), run.iterations)
    return Answer(
        **facts,
        status="ok",
        T_cam_obj=best.T_cam_obj,
        middle_m=target.model.middle_m,
        score=best.score.score,
        initial_score=float(initial.score.max()),
        colour_fit=best.score.colour_fit,
        plausibility=best.score.plausibility,
        recorded_score=target.instance.recorded_score(best.T_cam_obj),
        **_with_error_seen(_errors(problem, target, best, initial), run, target, best.T_cam_obj),
        best_hypothesis=best.arm + 1,
        best_iteration=best.iteration,
        worst_iteration=worst_iteration(target, iterations, best if method_of(session.method.name).verifies else None),
        undetermined_mm=allowed.undetermined_mm,
        undetermined_deg=allowed.undetermined_deg,
        n_alike=len(allowed.alike),
        n_iterations=len(iterations),
        events=_counted(iterations),
        **_times(iterations),
        message="; ".join(
            filter(None, (_cut_short(problem), _no_physics(problem, session), _right_by_add_s_only(target, best)))
        ),
    )


def _cut_short(problem: Problem) -> str:
    return NOT_CLOSED if NOT_CLOSED in problem.notes else ""


def object_facts(problem: Problem, target: Target, method: str) -> dict[str, Any]:
    """The columns about an object that do not depend on its answer."""
    instance = target.instance
    return {
        "frame": problem.frame,
        "instance_id": instance.instance_id,
        "obj_id": instance.obj_id,
        "name": target.model.name,
        "method": method,
        "diameter_mm": target.model.diameter_m * 1e3,
        "visib_fract": instance.visib_fract,
        "missing_depth": missing_depth(target),
        "n_hypotheses": len(instance.hypotheses),
    }


def missing_depth(target: Target) -> float | None:
    """Share of an object's mask without depth; None where the mask is empty."""
    depth_m = target.observation.depth_m[target.instance.mask]
    return float((depth_m == 0).mean()) if depth_m.size else None


def _errors(problem: Problem, target: Target, best: Best, initial: Scores) -> dict[str, Any]:
    T_gt = target.instance.T_cam_obj_gt
    if T_gt is None:
        return {}
    first = target.instance.hypotheses[int(np.argmax(initial.score))].T_cam_obj
    errors = answer_errors(target, best.T_cam_obj, problem.observation)
    return {**errors, "initial_add_s_mm": add_s_mm(target.model, first, T_gt)}


def _with_error_seen(errors: dict[str, Any], run: Run, target: Target, T_est: Float) -> dict[str, Any]:
    """The errors, and how far the answer is from the nearest pose that the image allows beside ground truth."""
    T_gt, limit_mm = target.instance.T_cam_obj_gt, CORRECT * 1e3 * target.model.diameter_m
    if T_gt is None:
        return errors
    seen_mm = errors["add_s_mm"]
    if seen_mm >= limit_mm:
        of_gt = allowed_poses(run.final_verifier, target, T_gt, (), run.iterations)
        seen_mm = min(seen_mm, nearest_allowed(of_gt, target.model, T_est)[1])
    return {**errors, "error_seen_mm": seen_mm, "right_seen": seen_mm < limit_mm}


def answer_errors(target: Target, T_est: Float, observation: Observation) -> dict[str, Any]:
    """The columns about how far an answer is from the ground truth of its object, which is known.

    Args:
        target: the object.
        T_est: (4, 4) the answer [m].
        observation: of the frame, whose depth says what is visible.
    """
    T_gt = target.instance.T_cam_obj_gt
    assert T_gt is not None
    errors, recalls = pose_errors(target.model, T_est, T_gt), answer_recalls(target, T_est, observation)
    return {
        "add_s_mm": errors.add_s_mm,
        "rotation_deg": errors.rotation_deg,
        "translation_mm": errors.translation_mm,
        "ar": recalls.ar,
        "ar_vsd": recalls.ar_vsd,
        "ar_mssd": recalls.ar_mssd,
        "ar_mspd": recalls.ar_mspd,
    }


def _right_by_add_s_only(target: Target, best: Best) -> str:
    """Says that an answer counts as right though it is near no pose that looks the same; empty where it is near one."""
    add = add_where_add_s_is_below(target, best.T_cam_obj, CORRECT)
    return "" if add is None else f"right by ADD-S only: ADD over the declared symmetries is {add:.0%} of the diameter"


def worst_iteration(target: Target, iterations: Sequence[Iteration], answer: Best | None = None) -> int | None:
    """The iteration that gave up a correct pose for a wrong answer; else the one after which this object was further
    from its goal than before it, by most.

    The latter is measured by the error of the accepted pose against the one it started from, or by the score where
    there is no ground truth. None if no iteration lost much (:data:`MUCH`, :data:`MUCH_SCORE`).

    Args:
        target: the object.
        iterations: its own.
        answer: where the best score decided what the answer is.
    """
    T_gt = target.instance.T_cam_obj_gt

    @cache
    def error_mm(pose: bytes) -> float:
        """ADD(-S) of a T_cam_obj [mm]. An iteration starts where an earlier one ended: half of the poses come twice."""
        assert T_gt is not None
        return add_s_mm(target.model, np.frombuffer(pose).reshape(4, 4), T_gt)

    if T_gt is not None:
        correct_mm = CORRECT * target.model.diameter_m * 1e3
        given_up = discarded(iterations, answer, lambda T: error_mm(T.tobytes()) < correct_mm)
        if given_up is not None:
            return given_up.given_up
    worst, most = None, MUCH * target.model.diameter_m * 1e3 if T_gt is not None else MUCH_SCORE
    for iteration in iterations:
        before, after = iteration.stages[0], iteration.accepted_stage
        if T_gt is not None:
            loss = error_mm(after.T_cam_obj.tobytes()) - error_mm(before.T_cam_obj.tobytes())
        else:
            loss = (before.score.score if before.score else 0.0) - (after.score.score if after.score else 0.0)
        if loss > most:
            worst, most = iteration.index, loss
    return worst


def _counted(iterations: Sequence[Iteration]) -> str:
    counts = Counter(event.kind for iteration in iterations for event in iteration.events)
    return "; ".join(f"{kind} {counts[kind]}" for kind in sorted(counts))


def _times(iterations: Sequence[Iteration]) -> dict[str, Any]:
    stages = [stage for iteration in iterations for stage in iteration.stages]
    return {
        "ms_refine": sum((s.ms for s in stages if s.name == "refined"), 0.0),
        "ms_simulate": sum((s.ms for s in stages if s.name == "simulated"), 0.0),
        "ms_score": sum((i.score_ms for i in iterations), 0.0),
        "ms_total": sum((i.ms for i in iterations), 0.0),
    }
