"""The iterations of a branch as the browser keeps them: message ``run``."""

from __future__ import annotations

from typing import Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.page.branch import Branch
from verefine_viz.page.moment import clusters_of, labels_of, state_of
from verefine_viz.page.views.recorded_poses import step_of
from verefine_viz.page.words import brief, sentence, source_of, stage_sentence
from verefine_viz.run.edits import never_reached

Json = dict[str, Any]


def pose_list(T_cam_obj: Float) -> list[float]:
    """Write a pose by rows, 16 numbers."""
    return [float(x) for x in T_cam_obj.ravel()]


def run_message(branch: Branch, first: int, oldest: Branch) -> Json:
    """Return the iterations after the ``first``, and what holds of the whole run so far.

    Where another branch than the ``oldest`` begins with other poses than that, message ``frame`` does not have them.
    """
    run = branch.run
    return {
        "t": "run",
        "branch": branch.index,
        "from": first,
        "total": max(run.n_iterations, run.length),
        "over": run.is_done,
        "missing": branch.missing,
        "rows": rows(branch, first),
        "start": _other_start(branch, oldest) if first == 0 and branch is not oldest else None,
        "marks": branch.marks(),
        "notes": _never_reached(branch),
    }


def initial_poses(branch: Branch, target: Target) -> list[Json]:
    """Return the poses with which the hypotheses of an object begin."""
    own = state_of(branch.run.state_at(0), target)
    if own is None:
        return []
    starts = zip(own.arms, target.instance.hypotheses, strict=False)
    return [
        {
            "T": pose_list(arm.current.T_cam_obj),
            "score": arm.current.score.score,
            **errors_of(branch, target, arm.current.T_cam_obj, 0),
            "plays": float(arm.plays),
            "mean": float(arm.mean),
            "source": source_of(hypothesis),
            "confidence": hypothesis.confidence,
        }
        for arm, hypothesis in starts
    ]


def _never_reached(branch: Branch) -> tuple[str, ...]:
    """Note what lies behind the end of the run; nothing while a change on the way may still make it longer."""
    run = branch.run
    if any(run.length < change.after_iteration <= run.n_iterations for change in branch.changes):
        return ()
    return never_reached(run.edits, branch.changes, max(run.n_iterations, run.length))


def _other_start(branch: Branch, oldest: Branch) -> dict[int, list[Json]] | None:
    """Return by instance what hypotheses begin with, where the oldest branch has others, or scores them otherwise."""
    begun = {t.instance.instance_id: initial_poses(oldest, t) for t in oldest.run.problem.targets}
    start = {t.instance.instance_id: initial_poses(branch, t) for t in branch.run.problem.targets}
    return {own: poses for own, poses in start.items() if poses != begun.get(own)} or None


def rows(branch: Branch, first: int) -> list[Json]:
    """Return a row for each iteration after the ``first``."""
    cluster_of = {i: k for k, cluster in enumerate(clusters_of(branch), 1) for i in cluster}
    return [_row(branch, iteration, cluster_of) for iteration in branch.run.iterations[first:]]


def _row(branch: Branch, iteration: Iteration, cluster_of: dict[int, int]) -> Json:
    run, k = branch.run, iteration.index
    target = run.problem.target(iteration.instance_id)
    refiner = branch.settings.method.refiner if step_of(target, iteration) is None else "recorded"
    labels = labels_of(run.problem)
    own = sum(i.instance_id == iteration.instance_id for i in run.iterations[:k])
    choice = iteration.choice
    return {
        "k": k,
        "obj": iteration.instance_id,
        "arm": iteration.arm,
        "n": iteration.arm_iteration,
        "own": own,
        "pass": iteration.scene_pass,
        "cluster": cluster_of.get(iteration.instance_id, 1),
        "stages": _stages(branch, iteration, target, refiner),
        "accepted": iteration.accepted,
        "best": best(branch, target, iteration.best, k),
        "events": [(event.kind, event.text) for event in iteration.events],
        "choice": choice
        and {
            "plays": choice.plays.tolist(),
            "mean": choice.mean.tolist(),
            "bonus": choice.exploration.tolist(),
            "ucb": choice.ucb.tolist(),
            "reason": choice.reason,
        },
        "arms": arms(branch, target, state_of(run.state_scored_at(k), target), k),
        "path": None if iteration.path is None else len(iteration.path.Ts_cam_obj),
        "placed": [{"obj": p.instance_id, "T": pose_list(p.T_cam_obj)} for p in iteration.placed],
        "scene": _scene(iteration),
        "tree": _tree(iteration),
        "ms": iteration.ms,
        "brief": brief(iteration, target),
        "text": sentence(iteration, target, refiner, labels, run.problem),
    }


def _stages(branch: Branch, iteration: Iteration, target: Target, refiner: str) -> list[Json]:
    out = []
    for j, stage in enumerate(iteration.stages):
        score = stage.score
        out.append(
            {
                "name": stage.name,
                "score": score and score.score,
                "depth_fit": score and score.depth_fit,
                "normal_fit": score and score.normal_fit,
                "colour_fit": score and score.colour_fit,
                "plausibility": score and score.plausibility,
                **errors_of(branch, target, stage.T_cam_obj, iteration.index),
                "ms": stage.ms,
                "T": pose_list(stage.T_cam_obj),
                "text": stage_sentence(iteration, j, target, refiner),
            }
        )
    return out


def errors_of(branch: Branch, target: Target, T_cam_obj: Float, k: int) -> Json:
    """Return the errors of a pose: ADD(-S) [mm], rotation [deg], translation [mm]; None without ground truth."""
    errors = branch.evaluator_of(k).errors(target, T_cam_obj)
    if errors is None:
        return {"err": None, "deg": None, "mm": None}
    return {"err": errors.add_s_mm, "deg": errors.rotation_deg, "mm": errors.translation_mm}


def best(branch: Branch, target: Target, one: Best, k: int) -> Json:
    """Return an answer."""
    return {
        "score": one.score.score,
        **errors_of(branch, target, one.T_cam_obj, k),
        "arm": one.arm,
        "k": one.iteration,
        "stage": one.stage,
        "T": pose_list(one.T_cam_obj),
    }


def arms(branch: Branch, target: Target, own: Any, k: int) -> list[Json]:
    """Return the hypotheses of an object with their plays, means and current poses."""
    if own is None:
        return []
    return [
        {
            "plays": float(arm.plays),
            "mean": float(arm.mean),
            "score": arm.current.score.score,
            "err": errors_of(branch, target, arm.current.T_cam_obj, k)["err"],
            "T": pose_list(arm.current.T_cam_obj),
        }
        for arm in own.arms
    ]


def _scene(iteration: Iteration) -> Json | None:
    record = iteration.scene
    if record is None:
        return None
    return {
        "number": iteration.scene_pass,
        "score": record.score.score,
        "best_known": record.best_known.score,
        "reward": record.reward,
        "incumbent": record.incumbent_score,
    }


def _tree(iteration: Iteration) -> Json | None:
    step = iteration.tree
    if step is None:
        return None
    return {
        "cluster": step.cluster,
        "branch": step.branch,
        "node": step.node
        and {"node": step.node.node, "parent": step.node.parent, "obj": step.node.instance_id, "arm": step.node.arm,
             "lcp": step.node.lcp},
        "choices": step.choices,
        "rollout": [{"obj": p.instance_id, "T": pose_list(p.T_cam_obj)} for p in step.rollout],
        "cost": step.cost_px,
        "incumbent": step.incumbent_cost_px,
    }  # fmt: skip
