"""Builds the :class:`Snapshot` of a state: gathers, scores and measures what is to be shown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Instance, Problem, Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.core.scores import PoseScore
from verefine_viz.core.settings import Session
from verefine_viz.diagnosis.causes import Cause
from verefine_viz.diagnosis.signs import FinishedObject
from verefine_viz.methods.registry import method_of
from verefine_viz.pictures.refiner_crops import start_words
from verefine_viz.viewer.snapshot.compared_poses import compared_poses, compared_scenes
from verefine_viz.viewer.snapshot.comparison_snapshot import comparison_snapshot
from verefine_viz.viewer.snapshot.finished_objects import finished_objects
from verefine_viz.viewer.snapshot.frame_track import frame_track
from verefine_viz.viewer.snapshot.scene_state import SceneState, known_physics, others_of, scene_state, work_out
from verefine_viz.viewer.snapshot.snapshot import BranchSummary, EvaluatedPose, Progress, Snapshot
from verefine_viz.viewer.state.batch_gallery import Entry
from verefine_viz.viewer.state.branch import Branch
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator, together
from verefine_viz.viewer.state.page_link import link_of
from verefine_viz.viewer.state.state import State
from verefine_viz.viewer.state.timeline_marks import RED, Mark
from verefine_viz.viewer.state.view_options import (
    AGAINST,
    ViewOptions,
    answered,
    is_answer,
    is_partial,
    revealed,
)


def snapshot_of(state: State, deep: bool = True) -> Snapshot:
    """Everything the panels and the scene need, at this moment; ``deep``: with what takes longer."""
    space = state.workspace
    work, branch = space.work, space.branch
    run, evaluator = branch.run, branch.evaluator
    answer = is_answer(run, state.options)
    options = state.comparison.visible(answered(state.options) if answer else state.options)
    target, shown = _focus(branch, options)
    running = state.running.goal is not None
    finished = () if running else finished_objects(branch)
    done = next((o for o in finished if o.instance_id == target.instance.instance_id), None) if answer else None
    options = _against(options, done)
    partial = is_partial(run, options)
    # Stage by stage an iteration has no result yet: neither an answer nor, where it is the newest, a place in curves.
    now = run.state_at(run.cursor - 1) if partial else branch.state
    iterations = run.iterations[:-1] if partial and run.cursor == run.length else run.iterations
    own_state = state_of(now, target)
    method = method_of(branch.settings.method.name)
    stage = options.stage if partial else None
    scene = scene_state(
        work.problem, now, run.iterations, run.cursor, evaluator.errors, not method.knows_others, answer, stage
    )
    best = scene.object(target.instance.instance_id).answer if answer else None
    arm = _arm(options, best if best is not None else shown, own_state)
    rescored = _rescored(shown, target, evaluator, branch)
    rival = done.runner_up.pose if done is not None and done.runner_up is not None else None
    poses = _poses(evaluator, target, rescored, own_state, arm, options, shown is run.iteration, best, rival)
    # Of an answer is shown what the refiner saw in the iteration that made it.
    made = run.iterations[best.iteration - 1] if best is not None and best.iteration else None
    wants_crops, of = deep and options.refiner_crops, f"iteration {made.index}" if made is not None else ""
    own = [i for i in iterations if i.instance_id == target.instance.instance_id]
    in_passes = answer and any(i.scene_pass is not None for i in own)
    if "best" in poses and (method.has_tree or in_passes):
        poses["best"] = replace(poses["best"], is_of_best_scene=True)
    session, entry = space.session, state.browsing.entry(target.instance.instance_id)
    progress = Progress(run.length, run.n_iterations, running, state.running.remaining_s(run))
    compared = comparison_snapshot(state.comparison, branch, target, options.focus is not None, options.whole_scene)
    # While a pose is edited it is what is compared, with the accepted one.
    of_runs = compared if options.edited is None else None
    if options.whole_scene and len(scene.objects) > 1:
        map_target = _scene_target(work.problem)
        a, b = compared_scenes(evaluator, scene, options, branch, deep, of_runs)
    else:
        map_target = target
        a, b = compared_poses(evaluator, target, poses, options, deep, of_runs)
    targets = {t.instance.instance_id: t for t in work.problem.targets}
    grasped = poses.get("edited") or poses.get("best")
    return Snapshot(
        session=branch.settings.model_copy(
            update={"breakpoints": space.breakpoints, "edits": session.edits, "changes": session.changes}
        ),
        session_path=space.path,
        session_file=next(reversed(space.files), None),
        frames=space.frames,
        track=frame_track(
            state.browsing.folder_of(target.instance.instance_id),
            getattr(space.tools, "source", None),
            target,
            space.frame,
            evaluator.known_near_symmetries(target.model),
            space.final_scores(target.instance.obj_id),
        ),
        frame=space.frame,
        link=link_of(state).text,
        demos=state.demos,
        sessions=state.sessions,
        batch=state.browsing.gallery,
        entry=entry,
        problem=work.problem,
        exploration=branch.exploration_after(run.cursor),
        doubts=branch.doubts(),
        recording=branch.recording,
        missing=branch.missing,
        branches=tuple(_summary(b, branch) for b in work.branches),
        branch=work.index,
        cursor=run.cursor,
        progress=progress,
        iterations=iterations,
        marks=tuple(m for m in shown_marks(branch, entry) if not (partial and m.iteration == run.cursor)),
        is_answer=answer,
        is_partial=partial,
        shown=shown,
        target=target,
        state=own_state,
        begun=state_of(run.state_scored_at(own[0].index), target) if own else own_state,
        poses=poses,
        arm=arm,
        options=options,
        a=a,
        b=b,
        plausible=_plausible(evaluator, target, poses, scene) if deep or options.edited is not None else {},
        initial_errors=tuple(evaluator.errors(target, h.T_cam_obj) for h in target.instance.hypotheses),
        error_series=tuple(
            (i, evaluator.errors(target, i.accepted_stage.T_cam_obj), evaluator.errors(target, i.best.T_cam_obj))
            for i in own
        ),
        ground_truth=poses.get("ground truth"),
        **_landscape(evaluator, target, poses, own, options),
        scene=scene,
        finished=finished,
        frame_score=_frame_score(evaluator, scene, branch.settings),
        map_target=map_target,
        best_errors={i.index: evaluator.errors(targets[i.instance_id], i.best.T_cam_obj) for i in iterations}
        if options.whole_scene
        else {},
        physics=known_physics(scene, evaluator),
        **_refiner(branch, target, made or shown, wants_crops and (made is not None or "refined" in poses), of),
        grasp=state.grasps.known(
            work.problem, branch.settings.grasp, target.instance.instance_id, grasped and grasped.T_cam_obj
        ),
        deep=deep,
        message=state.message,
        refused=state.refused,
        offer=state.offer,
        written=state.written,
        comparison=compared,
    )


def _refiner(branch: Branch, target: Target, iteration: Iteration | None, is_wanted: bool, of: str) -> dict[str, Any]:
    """The refiner of the iteration; what it saw only where that is wanted, as it runs its network for it.

    Args:
        branch: of the run.
        target: the object in focus.
        iteration: None = none was made.
        is_wanted: whether what it saw is to be shown.
        of: named before where it began.
    """
    refiner = (branch.run.method if iteration is None else branch.run.method_of(iteration.index)).refiner
    start = None if iteration is None else iteration.before_refined
    if not is_wanted or start is None or not isinstance(refiner, LearnedRefiner):
        return {"refiner": refiner}
    return {
        "refiner": refiner,
        "refiner_steps": branch.evaluator.refiner_steps(refiner, target, start.T_cam_obj),
        "refiner_start": ": ".join(filter(None, (of, start_words(refiner, target, start.T_cam_obj)))),
    }


def state_of(state: Any, target: Target) -> Any:
    """The method's state of one object; None where it has no hypothesis."""
    ids = [t.instance.instance_id for t in state.problem.targets]
    return state.objects[ids.index(target.instance.instance_id)]


def _focus(branch: Branch, options: ViewOptions) -> tuple[Target, Iteration | None]:
    """The object in focus and the latest iteration up to the cursor that worked on it."""
    run = branch.run
    targets = {t.instance.instance_id: t for t in run.problem.targets}
    if options.focus is not None:
        focus = options.focus
    elif run.iteration is not None:
        focus = run.iteration.instance_id
    else:
        focus = next((k for k, t in targets.items() if t.instance.hypotheses), next(iter(targets)))
    past = run.iterations[: run.cursor]
    return targets[focus], next((i for i in reversed(past) if i.instance_id == focus), None)


def shown_marks(branch: Branch, entry: Entry | None) -> tuple[Mark, ...]:
    """Of the history; until its run ends, where a correct pose was given up is known from the batch alone."""
    marks = branch.marks()
    if entry is None or entry.row.cause != Cause.DISCARDED or any(m.kind == "discarded" for m in marks):
        return marks
    at = entry.row.worst_iteration
    if at is None or at > branch.run.length:
        return marks
    return tuple(sorted((*marks, Mark(at, "discarded", entry.row.evidence, RED)), key=lambda mark: mark.iteration))


def _against(options: ViewOptions, finished: FinishedObject | None) -> ViewOptions:
    """``options`` where the answer is shown: one that is wrong is compared with ground truth, one of which that is
    unknown with its runner-up, unless the user has chosen.
    """
    if finished is None or finished.answer is None or options.has_chosen:
        return options
    with_gt, with_runner_up = AGAINST
    if finished.is_wrong:
        return replace(options, a=with_gt[0], b=with_gt[1])
    if finished.errors is None and finished.runner_up is not None:
        return replace(options, a=with_runner_up[0], b=with_runner_up[1], layers=options.layers | {"runner-up"})
    return options


def _rescored(shown: Iteration | None, target: Target, evaluator: CachedEvaluator, branch: Branch) -> Iteration | None:
    """An iteration with scores of ``evaluator``: those of its own time may be of other settings."""
    if shown is None or branch.evaluator_of(shown.index) is evaluator:
        return shown
    stages = tuple(s if s.score is None else s.with_score(evaluator.score(target, s.T_cam_obj)) for s in shown.stages)
    return structs.replace(shown, stages=stages)


def _arm(options: ViewOptions, shown: Iteration | Best | None, state: Any) -> int:
    if options.arm is not None:
        return min(options.arm, (len(state.arms) if state is not None else 1) - 1)
    if shown is not None:
        return shown.arm
    return state.best.arm if state is not None else 0


def _poses(
    evaluator: CachedEvaluator,
    target: Target,
    shown: Iteration | None,
    state: Any,
    arm: int,
    options: ViewOptions,
    is_current: bool,
    answer: Best | None,
    runner_up: Best | None,
) -> dict[str, EvaluatedPose]:
    """By stage, those that exist: of the iteration ``shown``, or instead of it the ``answer`` and its ``runner_up``."""
    poses: dict[str, EvaluatedPose] = {}

    def add(name: str, T_cam_obj: Float, score: PoseScore | None, ms: float = 0.0) -> None:
        poses[name] = EvaluatedPose(name, T_cam_obj, score, evaluator.errors(target, T_cam_obj), ms)

    if state is not None:
        initial = state.arms[arm].entries[0]
        add("initial", initial.T_cam_obj, initial.score)
    if answer is None and shown is not None:
        stages = revealed(shown, options.stage if is_current else None)
        for stage in shown.stages[: len(stages)]:
            add(stage.name, stage.T_cam_obj, stage.score or evaluator.score(target, stage.T_cam_obj), stage.ms)
        if len(stages) == len(shown.stages):
            accepted = shown.accepted_stage
            add("accepted", accepted.T_cam_obj, accepted.score, accepted.ms)
    elif answer is None and state is not None:
        now = state.arms[arm].current
        add("current", now.T_cam_obj, now.score)
    best = answer or (state.best if state is not None else None)
    if best is not None:
        add("best", best.T_cam_obj, best.score)
    if runner_up is not None:
        add("runner-up", runner_up.T_cam_obj, runner_up.score)
    if options.T_cam_obj_edited is not None:
        add("edited", options.T_cam_obj_edited, evaluator.score(target, options.T_cam_obj_edited))
    T_gt = target.instance.T_cam_obj_gt
    if T_gt is not None:
        add("ground truth", T_gt, evaluator.score(target, T_gt))
    return poses


# Plausibility of poses in focus: among other objects only what was worked out already, but of the edited pose at once


def plausibility_stages(poses: dict[str, EvaluatedPose]) -> tuple[str, ...]:
    """Poses whose plausibility is shown: before the simulation and accepted, or the answer; then the edited one."""
    stages = [k for k in ("current", "accepted") if k in poses] or [k for k in ("best",) if k in poses]
    return (*stages, *(k for k in ("edited",) if k in poses))


def _plausible(
    evaluator: CachedEvaluator, target: Target, poses: dict[str, EvaluatedPose], scene: SceneState
) -> dict[str, Any]:
    others = others_of(scene, target.instance.instance_id)
    by_stage = {}
    for k in plausibility_stages(poses):
        ask = evaluator.known_plausibility if others and k != "edited" else evaluator.plausibility
        by_stage[k] = ask(target, poses[k].T_cam_obj, others)
    return {k: plausibility for k, plausibility in by_stage.items() if plausibility is not None}


def deferred_physics(snapshot: Snapshot, evaluator: CachedEvaluator) -> Iterator[None]:
    """What the scene's physics still lacks, one thing per turn."""
    poses = [(snapshot.target, snapshot.poses[k].T_cam_obj) for k in plausibility_stages(snapshot.poses)]
    return work_out(snapshot.scene, evaluator, poses if len(snapshot.scene.objects) > 1 else ())


def _landscape(
    evaluator: CachedEvaluator,
    target: Target,
    poses: dict[str, EvaluatedPose],
    own: Sequence[Iteration],
    options: ViewOptions,
) -> dict[str, Any]:
    """What is known of the score around the best pose, as fields of the snapshot."""
    if "best" not in poses:
        return {"landscape": None, "score_slice": None, "other_pose": None, "near_symmetries": None}
    T = poses["best"].T_cam_obj
    return {
        "landscape": evaluator.known_landscape(target, T),
        "score_slice": evaluator.known_slice(target, T, options.slice_axes),
        "other_pose": evaluator.known_other_pose(target, T, own)[1],
        "near_symmetries": evaluator.known_near_symmetries(target.model),
    }


def lacks_landscape(snapshot: Snapshot, evaluator: CachedEvaluator) -> bool:
    """Whether the score around the best pose is still to be worked out."""
    if not snapshot.wants_landscape:
        return False
    T, own = snapshot.poses["best"].T_cam_obj, snapshot.own_iterations
    return snapshot.score_slice is None or not evaluator.known_other_pose(snapshot.target, T, own)[0]


def lacks_turns(snapshot: Snapshot, evaluator: CachedEvaluator) -> bool:
    """Whether what looks like a jump in a sequence may be a flip, as the model's near-symmetries are unknown."""
    jumps = any(one.motion.kind == "jump" for one in snapshot.track)
    return jumps and evaluator.known_near_symmetries(snapshot.target.model) is None


def deferred_turns(snapshot: Snapshot, evaluator: CachedEvaluator) -> Iterator[None]:
    """The near-symmetries of the model in focus."""
    evaluator.near_symmetries(snapshot.target.model)
    yield


def deferred_landscape(snapshot: Snapshot, evaluator: CachedEvaluator) -> Iterator[None]:
    """The score around the best pose, one batch of poses per turn."""
    target, T = snapshot.target, snapshot.poses["best"].T_cam_obj
    evaluator.landscape(target, T)
    yield
    evaluator.score_slice(target, T, snapshot.options.slice_axes)
    yield
    evaluator.near_symmetries(target.model)
    yield
    evaluator.other_pose(target, T, snapshot.own_iterations)


@lru_cache(maxsize=4)
def _scene_target(problem: Problem) -> Target:
    """All objects as if they were one: what score maps are cut to and coloured by."""
    mask = np.any([i.mask for i in problem.instances], axis=0)
    model = max(problem.models.values(), key=lambda model: model.diameter_m)
    return Target(problem.observation, Instance(-1, model.obj_id, mask, np.zeros((0, 3)), ()), model)


def _frame_score(evaluator: CachedEvaluator, scene: SceneState, session: Session) -> PoseScore | None:
    known = [(o.target, o.answer.T_cam_obj) for o in scene.objects if o.answer is not None]
    if len(known) < 2:
        return None
    return together(evaluator, [target for target, _ in known], np.array([T for _, T in known]), session)


def _summary(branch: Branch, shown: Branch) -> BranchSummary:
    run, state = branch.run, branch.run.final_state
    other_scale = branch.final_evaluator.verifier.settings != shown.final_evaluator.verifier.settings
    errors = [
        branch.evaluator.errors(t, best.T_cam_obj) if best else None
        for t, best in zip(state.problem.targets, state.best, strict=True)
    ]
    return BranchSummary(branch.name, run.length, run.n_iterations, tuple(state.best), tuple(errors), other_scale)
