"""The iterations of a branch as the browser keeps them: message ``run``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.page.frame_messages import InitialPose
from verefine_viz.page.frame_objects import clusters_of, labels_of, state_of
from verefine_viz.page.run_messages import (
    ArmChoice,
    ArmState,
    BestPose,
    IterationRow,
    PlacedObject,
    RunMessage,
    ScenePass,
    ScoredStage,
    SearchNode,
    SearchStep,
)
from verefine_viz.page.wire import pose_numbers
from verefine_viz.run.edits import never_reached
from verefine_viz.run.iteration_words import brief, sentence, source_of, stage_sentence

if TYPE_CHECKING:
    from verefine_viz.page.branch import Branch


def run_message(branch: Branch, first: int, oldest: Branch) -> RunMessage:
    """Return the iterations after the ``first``, and facts about the whole run so far.

    Initial poses that differ from those of the ``oldest`` branch are included, as message ``frame`` lacks them.
    """
    run = branch.run
    return RunMessage(
        branch=branch.index,
        from_=first,
        total=max(run.n_iterations, run.length),
        over=run.is_done,
        missing=branch.missing,
        rows=rows(branch, first),
        start=_other_start(branch, oldest) if first == 0 and branch is not oldest else None,
        marks=branch.marks(),
        notes=_never_reached(branch),
    )


def initial_poses(branch: Branch, target: Target) -> list[InitialPose]:
    """Return the poses with which the hypotheses of an object begin."""
    own = state_of(branch.run.state_at(0), target)
    if own is None:
        return []
    starts = zip(own.arms, target.instance.hypotheses, strict=False)
    poses = []
    for arm, hypothesis in starts:
        err, deg, mm = errors_of(branch, target, arm.current.T_cam_obj, 0)
        poses.append(
            InitialPose(
                T=pose_numbers(arm.current.T_cam_obj),
                score=arm.current.score.score,
                err=err,
                deg=deg,
                mm=mm,
                plays=float(arm.plays),
                mean=float(arm.mean),
                source=source_of(hypothesis),
                confidence=hypothesis.confidence,
            )
        )
    return poses


def _never_reached(branch: Branch) -> tuple[str, ...]:
    """Return notes on settings and edits beyond the end of the run; none while a change on the way may still make it
    longer.
    """
    run = branch.run
    if any(run.length < change.after_iteration <= run.n_iterations for change in branch.changes):
        return ()
    return never_reached(run.edits, branch.changes, max(run.n_iterations, run.length))


def _other_start(branch: Branch, oldest: Branch) -> dict[int, list[InitialPose]] | None:
    """Return the initial poses by instance, where they or their scores differ from the oldest branch's."""
    begun = {t.instance.instance_id: initial_poses(oldest, t) for t in oldest.run.problem.targets}
    start = {t.instance.instance_id: initial_poses(branch, t) for t in branch.run.problem.targets}
    return {own: poses for own, poses in start.items() if poses != begun.get(own)} or None


def rows(branch: Branch, first: int) -> list[IterationRow]:
    """Return a row for each iteration after the ``first``."""
    cluster_of = {i: k for k, cluster in enumerate(clusters_of(branch), 1) for i in cluster}
    return [_row(branch, iteration, cluster_of) for iteration in branch.run.iterations[first:]]


def _row(branch: Branch, iteration: Iteration, cluster_of: dict[int, int]) -> IterationRow:
    run, k = branch.run, iteration.index
    target = run.problem.target(iteration.instance_id)
    refiner = branch.settings.method.refiner
    own = sum(i.instance_id == iteration.instance_id for i in run.iterations[:k])
    choice, own_arms = iteration.choice, arms(branch, target, state_of(run.state_scored_at(k), target), k)
    return IterationRow(
        k=k,
        obj=iteration.instance_id,
        arm=iteration.arm,
        n=iteration.arm_iteration,
        own=own,
        pass_=iteration.scene_pass,
        cluster=cluster_of.get(iteration.instance_id, 1),
        stages=_stages(branch, iteration, target, refiner),
        accepted=iteration.accepted,
        best=best(branch, target, iteration.best, k),
        events=[(event.kind, event.text) for event in iteration.events],
        choice=choice
        and ArmChoice(
            plays=choice.plays.tolist(),
            mean=choice.mean.tolist(),
            bonus=choice.exploration.tolist(),
            ucb=choice.ucb.tolist(),
            reason=choice.reason,
        ),
        arms=own_arms,
        path=None if iteration.path is None else len(iteration.path.Ts_cam_obj),
        placed=[PlacedObject(p.instance_id, pose_numbers(p.T_cam_obj)) for p in iteration.placed],
        scene=_scene(iteration),
        tree=_tree(iteration),
        ms=iteration.ms,
        brief=brief(iteration, len(own_arms)),
        text=sentence(iteration, target, refiner, labels_of(run.problem)),
    )


def _stages(branch: Branch, iteration: Iteration, target: Target, refiner: str) -> list[ScoredStage]:
    out = []
    for j, stage in enumerate(iteration.stages):
        score = stage.score
        err, deg, mm = errors_of(branch, target, stage.T_cam_obj, iteration.index)
        out.append(
            ScoredStage(
                name=stage.name,
                score=score and score.score,
                depth_fit=score and score.depth_fit,
                normal_fit=score and score.normal_fit,
                colour_fit=score and score.colour_fit,
                plausibility=score and score.plausibility,
                err=err,
                deg=deg,
                mm=mm,
                ms=stage.ms,
                T=pose_numbers(stage.T_cam_obj),
                text=stage_sentence(iteration, j, target, refiner),
            )
        )
    return out


def errors_of(
    branch: Branch, target: Target, T_cam_obj: Float, k: int
) -> tuple[float, float, float] | tuple[None, None, None]:
    """Return the errors of a pose: ADD(-S) [mm], rotation [deg], translation [mm]; None without ground truth."""
    errors = branch.evaluator_of(k).errors(target, T_cam_obj)
    return (None, None, None) if errors is None else (errors.add_s_mm, errors.rotation_deg, errors.translation_mm)


def best(branch: Branch, target: Target, one: Best, k: int) -> BestPose:
    """Return an answer."""
    err, deg, mm = errors_of(branch, target, one.T_cam_obj, k)
    return BestPose(one.score.score, err, deg, mm, one.arm, one.iteration, one.stage, pose_numbers(one.T_cam_obj))


def arms(branch: Branch, target: Target, own: Any, k: int) -> list[ArmState]:
    """Return the hypotheses of an object with their plays, means and current poses."""
    if own is None:
        return []
    return [
        ArmState(
            plays=float(arm.plays),
            mean=float(arm.mean),
            score=arm.current.score.score,
            err=errors_of(branch, target, arm.current.T_cam_obj, k)[0],
            T=pose_numbers(arm.current.T_cam_obj),
        )
        for arm in own.arms
    ]


def _scene(iteration: Iteration) -> ScenePass | None:
    record = iteration.scene
    if record is None or iteration.scene_pass is None:
        return None
    return ScenePass(
        number=iteration.scene_pass,
        score=record.score.score,
        best_known=record.best_known.score,
        reward=record.reward,
        incumbent=record.incumbent_score,
    )


def _tree(iteration: Iteration) -> SearchStep | None:
    step = iteration.tree
    if step is None:
        return None
    node = step.node
    return SearchStep(
        cluster=step.cluster,
        branch=step.branch,
        node=node and SearchNode(node.node, node.parent, node.instance_id, node.arm, node.lcp),
        choices=step.choices,
        rollout=[PlacedObject(p.instance_id, pose_numbers(p.T_cam_obj)) for p in step.rollout],
        cost=step.cost_px,
        incumbent=step.incumbent_cost_px,
    )
