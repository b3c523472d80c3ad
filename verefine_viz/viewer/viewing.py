"""Builds the :class:`View` of a debugger: gathers, scores and measures what is to be shown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.scores import PoseScore
from verefine_viz.evaluation.errors import PoseErrors
from verefine_viz.viewer.answer import OF_ITERATION, answered, is_answer, is_of_best_scene
from verefine_viz.viewer.branch import Branch
from verefine_viz.viewer.judge import Judge
from verefine_viz.viewer.later import known_physics, others_of, work_out
from verefine_viz.viewer.look import Look
from verefine_viz.viewer.maps import probe
from verefine_viz.viewer.revealing import is_partial, revealed
from verefine_viz.viewer.scene_now import SceneNow, scene_now
from verefine_viz.viewer.scene_sides import frame_score, scene_sides, scene_target
from verefine_viz.viewer.scene_words import ALONE
from verefine_viz.viewer.side_view import sides_view
from verefine_viz.viewer.view import BranchSummary, Judged, Progress, Side, View

if TYPE_CHECKING:
    from verefine_viz.viewer.debugger import Debugger


FALLBACK_A = ("current", "initial", "best", "ground truth")
FALLBACK_B = ("accepted", "best", "initial", "ground truth")
"""What is shown instead of a stage that does not exist at the cursor."""


def view_of(debugger: Debugger, deep: bool = True) -> View:
    """Everything the panels and the scene need, at this moment; ``deep``: with what takes longer."""
    space = debugger.workspace
    work, branch = space.work, space.branch
    run, judge = branch.run, branch.judge
    answer = is_answer(run, debugger.look)
    look = debugger.comparing.look(answered(debugger.look) if answer else debugger.look)
    target, shown = _focus(branch, look)
    partial = is_partial(run, look)
    # Stage by stage an iteration has no result yet: neither an answer nor, where it is the newest, a place in curves.
    now = run.state_at(run.cursor - 1) if partial else branch.state
    iterations = run.iterations[:-1] if partial and run.cursor == run.length else run.iterations
    state = state_of(now, target)
    truth = _truth(judge, target)
    alone = branch.settings.method.name in ALONE
    stage = look.stage if partial else None
    scene = scene_now(work.problem, now, run.iterations, run.cursor, judge.errors, alone, answer, stage)
    found = scene.object(target.instance.instance_id).answer if answer else None
    arm = _arm(look, found if found is not None else shown, state)
    told = _as_judged(shown, target, judge, branch)
    poses = _poses(judge, target, told, state, arm, look, is_current=shown is run.iteration, truth=truth)
    if found is not None:
        poses = {name: pose for name, pose in poses.items() if name not in OF_ITERATION}
        poses["best"] = Judged("best", found.T_cam_obj, found.score, judge.errors(target, found.T_cam_obj))
    own = [i for i in iterations if i.instance_id == target.instance.instance_id]
    if "best" in poses and is_of_best_scene(branch.settings.method.name, own, answer):
        poses["best"] = replace(poses["best"], is_of_best_scene=True)
    running, kept = debugger.running.goal is not None, space.session
    errors = [judge.errors(target, h.T_cam_obj) for h in target.instance.hypotheses]
    progress = Progress(run.length, run.n_iterations, running, debugger.running.remaining_s)
    if look.whole_scene and len(scene.objects) > 1:
        map_target = scene_target(work.problem)
        first = _first_poses(branch) if answer else None
        a, b = scene_sides(judge, scene, look, branch.settings, deep, first)
    else:
        map_target = target
        one = _or_else(poses, look.a, FALLBACK_A)
        other = _or_else(poses, look.b, (*_unlike(one, poses), *FALLBACK_B))
        a, b = (_side(judge, target, pose, look, deep) for pose in (one, other))
    return View(
        session=branch.settings.model_copy(
            update={"breakpoints": space.breakpoints, "edits": kept.edits, "changes": kept.changes}
        ),
        session_path=space.path,
        session_file=next(reversed(space.files), None),
        frames=space.frames,
        frame=space.frame,
        demos=debugger.demos,
        sessions=debugger.sessions,
        batch=debugger.browsing.gallery,
        entry=debugger.browsing.entry(target.instance.instance_id),
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
        state=state,
        begun=state_of(run.state_scored_at(own[0].index), target) if own else state,
        poses=poses,
        arm=arm,
        look=look,
        a=a,
        b=b,
        plausible=_plausible(judge, target, poses, scene) if deep or look.edited is not None else {},
        initial_errors=tuple(errors),
        error_series=_error_series(judge, target, iterations),
        truth=truth,
        # Up to half a second for a pose that is nearly such a turn: a run does not wait for it.
        undeclared=judge.undeclared_turn(target, poses["best"].T_cam_obj) if "best" in poses and not running else None,
        scene=scene,
        frame_score=frame_score(judge, scene, branch.settings),
        map_target=map_target,
        best_errors=_best_errors(judge, work.problem, iterations) if look.whole_scene else {},
        physics=known_physics(scene, judge),
        deep=deep,
        message=debugger.message,
        refused=debugger.refused,
        offer=debugger.offer,
        kept=debugger.kept,
        sides=sides_view(debugger.comparing, branch, target, look.focus is not None, look.whole_scene),
    )


def state_of(state: Any, target: Target) -> Any:
    """The method's state of one object; None where it has no hypothesis."""
    ids = [t.instance.instance_id for t in state.problem.targets]
    return state.objects[ids.index(target.instance.instance_id)]


def _focus(branch: Branch, look: Look) -> tuple[Target, Iteration | None]:
    """The object in focus and the latest iteration up to the cursor that worked on it."""
    run = branch.run
    targets = {t.instance.instance_id: t for t in run.problem.targets}
    at_cursor = run.iteration
    if look.focus is not None:
        focus = look.focus
    elif at_cursor is not None:
        focus = at_cursor.instance_id
    else:
        focus = next((k for k, t in targets.items() if t.instance.hypotheses), next(iter(targets)))
    past = run.iterations[: run.cursor]
    return targets[focus], next((i for i in reversed(past) if i.instance_id == focus), None)


def _as_judged(shown: Iteration | None, target: Target, judge: Judge, branch: Branch) -> Iteration | None:
    """An iteration with scores of ``judge``: those of its own time are of other settings where they changed since."""
    if shown is None or branch.judge_of(shown.index) is judge:
        return shown
    stages = tuple(s if s.score is None else replace(s, score=judge.score(target, s.T_cam_obj)) for s in shown.stages)
    return replace(shown, stages=stages)


def _arm(look: Look, shown: Iteration | Best | None, state: Any) -> int:
    if look.arm is not None:
        n = len(state.arms) if state is not None else 1
        return min(look.arm, n - 1)
    if shown is not None:
        return shown.arm
    return state.best.arm if state is not None else 0


def _truth(judge: Judge, target: Target) -> Judged | None:
    T = target.instance.T_cam_obj_gt
    return None if T is None else Judged("ground truth", T, judge.score(target, T), judge.errors(target, T))


def _poses(
    judge: Judge,
    target: Target,
    shown: Iteration | None,
    state: Any,
    arm: int,
    look: Look,
    is_current: bool,
    truth: Judged | None,
) -> dict[str, Judged]:
    found: dict[str, Judged] = {}

    def add(name: str, T_cam_obj: Float, score: PoseScore | None, ms: float = 0.0) -> None:
        found[name] = Judged(name, T_cam_obj, score, judge.errors(target, T_cam_obj), ms)

    if state is not None:
        first = state.arms[arm].entries[0]
        add("initial", first.T_cam_obj, first.score)
        if shown is None:
            now = state.arms[arm].current
            add("current", now.T_cam_obj, now.score)
    if shown is not None:
        told = revealed(shown, look.stage if is_current else None)
        for stage in shown.stages:
            if stage.name in told:
                score = stage.score or judge.score(target, stage.T_cam_obj)
                add(stage.name, stage.T_cam_obj, score, stage.ms)
        if len(told) == len(shown.stages):
            kept = shown.accepted_stage
            add("accepted", kept.T_cam_obj, kept.score, kept.ms)
    if state is not None:
        add("best", state.best.T_cam_obj, state.best.score)
    if look.T_cam_obj_edited is not None:
        T = np.array(look.T_cam_obj_edited)
        add("edited", T, judge.score(target, T))
    if truth is not None:
        found["ground truth"] = truth
    return found


def _plausible(judge: Judge, target: Target, poses: dict[str, Judged], scene: SceneNow) -> dict[str, Any]:
    """Of the poses whose standing is shown; among other objects only what was worked out already, and of the pose under
    the hand at once: whoever moves it waits for nothing else.
    """
    others = others_of(scene, target.instance.instance_id)
    found = {}
    for k in standing(poses):
        ask = judge.known_plausibility if others and k != "edited" else judge.plausibility
        found[k] = ask(target, poses[k].T_cam_obj, others)
    return {k: v for k, v in found.items() if v is not None}


def standing(poses: dict[str, Judged]) -> tuple[str, ...]:
    """Poses whose plausibility is told: before the simulation and what was kept, or the answer; then the edited one."""
    told = tuple(k for k in ("current", "accepted") if k in poses) or tuple(k for k in ("best",) if k in poses)
    return (*told, *(k for k in ("edited",) if k in poses))


def later(view: View, judge: Judge) -> Iterator[None]:
    """What the scene's physics still lacks, one thing per turn."""
    shown = [(view.target, view.poses[k].T_cam_obj) for k in standing(view.poses)]
    return work_out(view.scene, judge, shown if len(view.scene.objects) > 1 else ())


def _or_else(poses: dict[str, Judged], wanted: str, instead: tuple[str, ...]) -> Judged | None:
    return next((poses[name] for name in (wanted, *instead) if name in poses), None)


def _unlike(one: Judged | None, poses: dict[str, Judged]) -> tuple[str, ...]:
    """What says more beside ``one`` than the same pose once more: before the first iteration, the truth."""
    if one is None:
        return ()
    return tuple(n for n in FALLBACK_B if n in poses and not np.array_equal(poses[n].T_cam_obj, one.T_cam_obj))


def _side(judge: Judge, target: Target, pose: Judged | None, look: Look, deep: bool) -> Side | None:
    if pose is None:
        return None
    if not deep:
        return Side(pose, None)
    maps = judge.maps(target, pose.T_cam_obj)
    return Side(pose, maps, probe(maps, target, *look.pixel) if look.pixel else None)


def _summary(branch: Branch, shown: Branch) -> BranchSummary:
    state = branch.run.final_state
    other_scale = branch.final_judge.verifier.settings != shown.final_judge.verifier.settings
    errors = [
        branch.judge.errors(t, best.T_cam_obj) if best else None
        for t, best in zip(state.problem.targets, state.best, strict=True)
    ]
    run = branch.run
    return BranchSummary(branch.name, run.length, run.n_iterations, tuple(state.best), tuple(errors), other_scale)


def _first_poses(branch: Branch) -> dict[int, Float]:
    """By instance_id: the best pose before the first iteration."""
    state = branch.run.state_at(0)
    pairs = zip(state.problem.targets, state.best, strict=True)
    return {t.instance.instance_id: best.T_cam_obj for t, best in pairs if best is not None}


def _best_errors(judge: Judge, problem: Problem, iterations: Sequence[Iteration]) -> dict[int, PoseErrors | None]:
    targets = {t.instance.instance_id: t for t in problem.targets}
    return {i.index: judge.errors(targets[i.instance_id], i.best.T_cam_obj) for i in iterations}


def _error_series(judge: Judge, target: Target, iterations: tuple[Iteration, ...]) -> tuple[Any, ...]:
    own = [i for i in iterations if i.instance_id == target.instance.instance_id]
    return tuple(
        (i, judge.errors(target, i.accepted_stage.T_cam_obj), judge.errors(target, i.best.T_cam_obj)) for i in own
    )
