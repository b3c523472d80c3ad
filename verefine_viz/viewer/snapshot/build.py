"""Builds the :class:`Snapshot` of a debugger: gathers, scores and measures what is to be shown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Instance, Problem, Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.scores import PoseScore
from verefine_viz.core.settings import Session
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.methods.registry import method_of
from verefine_viz.viewer.snapshot.comparison import comparison_snapshot
from verefine_viz.viewer.snapshot.deferred_physics import known_physics, others_of, work_out
from verefine_viz.viewer.snapshot.partial_iteration import (
    OF_ITERATION,
    answered,
    is_answer,
    is_of_best_scene,
    is_partial,
    revealed,
)
from verefine_viz.viewer.snapshot.scene_state import SceneState, scene_state
from verefine_viz.viewer.snapshot.snapshot import BranchSummary, ComparedPose, EvaluatedPose, Progress, Snapshot, probe
from verefine_viz.viewer.state.branch import Branch
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator, together
from verefine_viz.viewer.state.state import State
from verefine_viz.viewer.state.view_options import ViewOptions

# The two combinations of poses that are compared where the whole scene is shown, scored as a scene.

FIRST = "initial poses"
"""What the scene before the run is called."""


def frame_score(evaluator: CachedEvaluator, scene: SceneState, session: Session) -> PoseScore | None:
    """The score of all answers so far, rendered together; None for a single object."""
    known = [(o.target, o.answer.T_cam_obj) for o in scene.objects if o.answer is not None]
    if len(known) < 2:
        return None
    return together(evaluator, [target for target, _ in known], np.array([T for _, T in known]), session)


@lru_cache(maxsize=4)
def scene_target(problem: Problem) -> Target:
    """All objects as if they were one: what score maps are cut to and coloured by."""
    mask = np.any([i.mask for i in problem.instances], axis=0)
    model = max(problem.models.values(), key=lambda model: model.diameter_m)
    return Target(problem.observation, Instance(-1, model.obj_id, mask, np.zeros((0, 3)), ()), model)


def compared_scenes(
    evaluator: CachedEvaluator,
    scene: SceneState,
    options: ViewOptions,
    session: Session,
    deep: bool,
    first: Mapping[int, Float] | None = None,
) -> tuple[ComparedPose | None, ComparedPose | None]:
    """A: the objects as they stand now, or at their ``first`` poses (4, 4) by instance_id. B: the answers so far."""
    known = [o for o in scene.objects if o.T_cam_obj is not None and o.answer is not None]
    if not known:
        return None, None
    now = np.array([first[o.instance_id] if first else o.T_cam_obj for o in known])
    best = np.array([o.answer.T_cam_obj for o in known if o.answer is not None])
    closed = scene.closes_pass
    name = FIRST if first else f"pass {closed.number}" if closed else "now"
    targets = [o.target for o in known]

    def side(name: str, Ts: Float) -> ComparedPose:
        score = together(evaluator, targets, Ts, session) if deep else None
        pose = EvaluatedPose(name, Ts, score, None)
        if not deep:
            return ComparedPose(pose, None)
        maps = evaluator.scene_maps(targets, Ts)
        return ComparedPose(pose, maps, probe(maps, targets[0], *options.pixel) if options.pixel else None)

    return side(name, now), side("best", best)


FALLBACK_A = ("current", "initial", "best", "ground truth")
FALLBACK_B = ("accepted", "best", "initial", "ground truth")
"""What is shown instead of a stage that does not exist at the cursor."""


def snapshot_of(state: State, deep: bool = True) -> Snapshot:
    """Everything the panels and the scene need, at this moment; ``deep``: with what takes longer."""
    space = state.workspace
    work, branch = space.work, space.branch
    run, evaluator = branch.run, branch.evaluator
    answer = is_answer(run, state.options)
    options = state.comparison.visible(answered(state.options) if answer else state.options)
    target, shown = _focus(branch, options)
    partial = is_partial(run, options)
    # Stage by stage an iteration has no result yet: neither an answer nor, where it is the newest, a place in curves.
    now = run.state_at(run.cursor - 1) if partial else branch.state
    iterations = run.iterations[:-1] if partial and run.cursor == run.length else run.iterations
    own_state = state_of(now, target)
    truth = _truth(evaluator, target)
    alone = not method_of(branch.settings.method.name).knows_others
    stage = options.stage if partial else None
    scene = scene_state(work.problem, now, run.iterations, run.cursor, evaluator.errors, alone, answer, stage)
    best = scene.object(target.instance.instance_id).answer if answer else None
    arm = _arm(options, best if best is not None else shown, own_state)
    rescored = _rescored(shown, target, evaluator, branch)
    poses = _poses(evaluator, target, rescored, own_state, arm, options, is_current=shown is run.iteration, truth=truth)
    if best is not None:
        poses = {name: pose for name, pose in poses.items() if name not in OF_ITERATION}
        poses["best"] = EvaluatedPose("best", best.T_cam_obj, best.score, evaluator.errors(target, best.T_cam_obj))
    own = [i for i in iterations if i.instance_id == target.instance.instance_id]
    if "best" in poses and is_of_best_scene(branch.settings.method.name, own, answer):
        poses["best"] = replace(poses["best"], is_of_best_scene=True)
    running, session = state.running.goal is not None, space.session
    errors = [evaluator.errors(target, h.T_cam_obj) for h in target.instance.hypotheses]
    progress = Progress(run.length, run.n_iterations, running, state.running.remaining_s(run))
    if options.whole_scene and len(scene.objects) > 1:
        map_target = scene_target(work.problem)
        first = _initial_poses(branch) if answer else None
        a, b = compared_scenes(evaluator, scene, options, branch.settings, deep, first)
    else:
        map_target = target
        one = _or_else(poses, options.a, FALLBACK_A)
        other = _or_else(poses, options.b, (*_unlike(one, poses), *FALLBACK_B))
        a, b = (_side(evaluator, target, pose, options, deep) for pose in (one, other))
    return Snapshot(
        session=branch.settings.model_copy(
            update={"breakpoints": space.breakpoints, "edits": session.edits, "changes": session.changes}
        ),
        session_path=space.path,
        session_file=next(reversed(space.files), None),
        frames=space.frames,
        frame=space.frame,
        demos=state.demos,
        sessions=state.sessions,
        batch=state.browsing.gallery,
        entry=state.browsing.entry(target.instance.instance_id),
        problem=work.problem,
        exploration=branch.exploration_after(run.cursor),
        doubts=branch.doubts(),
        recording=branch.recording,
        branches=tuple(_summary(b, branch) for b in work.branches),
        branch=work.index,
        cursor=run.cursor,
        progress=progress,
        iterations=iterations,
        marks=tuple(m for m in branch.marks() if not (partial and m.iteration == run.cursor)),
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
        initial_errors=tuple(errors),
        error_series=_error_series(evaluator, target, iterations),
        truth=truth,
        # Up to half a second for a pose that is nearly such a turn: a run does not wait for it.
        undeclared=evaluator.undeclared_turn(target, poses["best"].T_cam_obj)
        if "best" in poses and not running
        else None,
        scene=scene,
        frame_score=frame_score(evaluator, scene, branch.settings),
        map_target=map_target,
        best_errors=_best_errors(evaluator, work.problem, iterations) if options.whole_scene else {},
        physics=known_physics(scene, evaluator),
        deep=deep,
        message=state.message,
        refused=state.refused,
        offer=state.offer,
        written=state.written,
        comparison=comparison_snapshot(
            state.comparison, branch, target, options.focus is not None, options.whole_scene
        ),
    )


def state_of(state: Any, target: Target) -> Any:
    """The method's state of one object; None where it has no hypothesis."""
    ids = [t.instance.instance_id for t in state.problem.targets]
    return state.objects[ids.index(target.instance.instance_id)]


def _focus(branch: Branch, options: ViewOptions) -> tuple[Target, Iteration | None]:
    """The object in focus and the latest iteration up to the cursor that worked on it."""
    run = branch.run
    targets = {t.instance.instance_id: t for t in run.problem.targets}
    at_cursor = run.iteration
    if options.focus is not None:
        focus = options.focus
    elif at_cursor is not None:
        focus = at_cursor.instance_id
    else:
        focus = next((k for k, t in targets.items() if t.instance.hypotheses), next(iter(targets)))
    past = run.iterations[: run.cursor]
    return targets[focus], next((i for i in reversed(past) if i.instance_id == focus), None)


def _rescored(shown: Iteration | None, target: Target, evaluator: CachedEvaluator, branch: Branch) -> Iteration | None:
    """An iteration with scores of ``evaluator``: those of its own time may be of other settings."""
    if shown is None or branch.evaluator_of(shown.index) is evaluator:
        return shown
    stages = tuple(
        s if s.score is None else replace(s, score=evaluator.score(target, s.T_cam_obj)) for s in shown.stages
    )
    return replace(shown, stages=stages)


def _arm(options: ViewOptions, shown: Iteration | Best | None, state: Any) -> int:
    if options.arm is not None:
        n = len(state.arms) if state is not None else 1
        return min(options.arm, n - 1)
    if shown is not None:
        return shown.arm
    return state.best.arm if state is not None else 0


def _truth(evaluator: CachedEvaluator, target: Target) -> EvaluatedPose | None:
    T = target.instance.T_cam_obj_gt
    return (
        None if T is None else EvaluatedPose("ground truth", T, evaluator.score(target, T), evaluator.errors(target, T))
    )


def _poses(
    evaluator: CachedEvaluator,
    target: Target,
    shown: Iteration | None,
    state: Any,
    arm: int,
    options: ViewOptions,
    is_current: bool,
    truth: EvaluatedPose | None,
) -> dict[str, EvaluatedPose]:
    poses: dict[str, EvaluatedPose] = {}

    def add(name: str, T_cam_obj: Float, score: PoseScore | None, ms: float = 0.0) -> None:
        poses[name] = EvaluatedPose(name, T_cam_obj, score, evaluator.errors(target, T_cam_obj), ms)

    if state is not None:
        first = state.arms[arm].entries[0]
        add("initial", first.T_cam_obj, first.score)
        if shown is None:
            now = state.arms[arm].current
            add("current", now.T_cam_obj, now.score)
    if shown is not None:
        stages = revealed(shown, options.stage if is_current else None)
        for stage in shown.stages:
            if stage.name in stages:
                score = stage.score or evaluator.score(target, stage.T_cam_obj)
                add(stage.name, stage.T_cam_obj, score, stage.ms)
        if len(stages) == len(shown.stages):
            accepted = shown.accepted_stage
            add("accepted", accepted.T_cam_obj, accepted.score, accepted.ms)
    if state is not None:
        add("best", state.best.T_cam_obj, state.best.score)
    if options.T_cam_obj_edited is not None:
        T = np.array(options.T_cam_obj_edited)
        add("edited", T, evaluator.score(target, T))
    if truth is not None:
        poses["ground truth"] = truth
    return poses


def _plausible(
    evaluator: CachedEvaluator, target: Target, poses: dict[str, EvaluatedPose], scene: SceneState
) -> dict[str, Any]:
    """Of the poses whose plausibility is shown; among other objects only what was worked out already, but of the edited
    pose at once.
    """
    others = others_of(scene, target.instance.instance_id)
    found = {}
    for k in plausibility_stages(poses):
        ask = evaluator.known_plausibility if others and k != "edited" else evaluator.plausibility
        found[k] = ask(target, poses[k].T_cam_obj, others)
    return {k: v for k, v in found.items() if v is not None}


def plausibility_stages(poses: dict[str, EvaluatedPose]) -> tuple[str, ...]:
    """Poses whose plausibility is shown: before the simulation and accepted, or the answer; then the edited one."""
    stages = tuple(k for k in ("current", "accepted") if k in poses) or tuple(k for k in ("best",) if k in poses)
    return (*stages, *(k for k in ("edited",) if k in poses))


def deferred_physics(view: Snapshot, evaluator: CachedEvaluator) -> Iterator[None]:
    """What the scene's physics still lacks, one thing per turn."""
    shown = [(view.target, view.poses[k].T_cam_obj) for k in plausibility_stages(view.poses)]
    return work_out(view.scene, evaluator, shown if len(view.scene.objects) > 1 else ())


def _or_else(poses: dict[str, EvaluatedPose], wanted: str, instead: tuple[str, ...]) -> EvaluatedPose | None:
    return next((poses[name] for name in (wanted, *instead) if name in poses), None)


def _unlike(one: EvaluatedPose | None, poses: dict[str, EvaluatedPose]) -> tuple[str, ...]:
    """What says more beside ``one`` than the same pose once more: before the first iteration, the truth."""
    if one is None:
        return ()
    return tuple(n for n in FALLBACK_B if n in poses and not np.array_equal(poses[n].T_cam_obj, one.T_cam_obj))


def _side(
    evaluator: CachedEvaluator, target: Target, pose: EvaluatedPose | None, options: ViewOptions, deep: bool
) -> ComparedPose | None:
    if pose is None:
        return None
    if not deep:
        return ComparedPose(pose, None)
    maps = evaluator.maps(target, pose.T_cam_obj)
    return ComparedPose(pose, maps, probe(maps, target, *options.pixel) if options.pixel else None)


def _summary(branch: Branch, shown: Branch) -> BranchSummary:
    state = branch.run.final_state
    other_scale = branch.final_evaluator.verifier.settings != shown.final_evaluator.verifier.settings
    errors = [
        branch.evaluator.errors(t, best.T_cam_obj) if best else None
        for t, best in zip(state.problem.targets, state.best, strict=True)
    ]
    run = branch.run
    return BranchSummary(branch.name, run.length, run.n_iterations, tuple(state.best), tuple(errors), other_scale)


def _initial_poses(branch: Branch) -> dict[int, Float]:
    """By instance_id: the best pose before the first iteration."""
    state = branch.run.state_at(0)
    pairs = zip(state.problem.targets, state.best, strict=True)
    return {t.instance.instance_id: best.T_cam_obj for t, best in pairs if best is not None}


def _best_errors(
    evaluator: CachedEvaluator, problem: Problem, iterations: Sequence[Iteration]
) -> dict[int, PoseErrors | None]:
    targets = {t.instance.instance_id: t for t in problem.targets}
    return {i.index: evaluator.errors(targets[i.instance_id], i.best.T_cam_obj) for i in iterations}


def _error_series(evaluator: CachedEvaluator, target: Target, iterations: tuple[Iteration, ...]) -> tuple[Any, ...]:
    own = [i for i in iterations if i.instance_id == target.instance.instance_id]
    return tuple(
        (i, evaluator.errors(target, i.accepted_stage.T_cam_obj), evaluator.errors(target, i.best.T_cam_obj))
        for i in own
    )
