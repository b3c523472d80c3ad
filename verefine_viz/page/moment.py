"""A moment of a branch: after iteration k, or at its end, where every object stands and which poses there are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.palette import OBJECT_COLORS, RGB
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.methods.registry import method_of
from verefine_viz.page.branch import Branch
from verefine_viz.page.evaluator import CachedEvaluator
from verefine_viz.page.protocol import Look

Phase = Literal["waiting", "working", "placed", "rolled out", "done", "no pose"]


@dataclass(frozen=True, eq=False)
class SceneObject:
    """One object at a moment."""

    target: Target
    label: str
    """Its name, with the instance where the frame holds the object twice."""
    color: RGB
    phase: Phase
    """waiting: its turn (in this pass) is still to come. working: the iteration is about it. placed: it stood in the
    scene in that iteration. rolled out: a tree search completed the scene with it. done: it has used its budget, or
    the run is over. no pose: it has no hypothesis."""
    answer: Best | None
    """The answer so far; for methods that search for a scene, its pose in the best one."""
    T_cam_obj: Float | None
    """Where it stands in this iteration; the answer where it takes no part in it."""

    @property
    def instance_id(self) -> int:
        return self.target.instance.instance_id

    @property
    def placed(self) -> Placed | None:
        """The model where it stands."""
        return None if self.T_cam_obj is None else Placed(self.instance_id, self.target.model, self.T_cam_obj)


@dataclass(frozen=True, eq=False)
class Moment:
    """What a window looks at."""

    branch: Branch
    k: int
    target: Target
    """The object in focus."""
    iteration: Iteration | None
    """The latest up to k that worked on it."""
    is_answer: bool
    """Whether the run's answer is shown instead of that iteration."""
    poses: dict[str, Float]
    """Poses of the object by stage: ``initial``, those of the iteration as far as it is shown, ``accepted``, ``best``,
    ``runner-up``, ``edited``, ``ground truth``."""
    arm: int
    """The hypothesis in focus."""
    own: Any
    """The method's state of the object: ``arms``, ``best``; None where it has no hypothesis."""
    objects: tuple[SceneObject, ...]
    """In the order to solve them."""

    @property
    def evaluator(self) -> CachedEvaluator:
        """What evaluates by the settings of the moment."""
        return self.branch.evaluator_of(self.k + self.is_answer)

    @property
    def problem(self) -> Problem:
        return self.branch.run.problem

    def object(self, instance_id: int) -> SceneObject:
        """Return the object of that instance."""
        return next(o for o in self.objects if o.instance_id == instance_id)

    def others_of(self, instance_id: int) -> tuple[Placed, ...]:
        """Return the other objects where they stand."""
        return tuple(o.placed for o in self.objects if o.placed is not None and o.instance_id != instance_id)


def moment_of(branch: Branch, look: Look) -> Moment:
    """Work out what a window looks at in a branch.

    Raises:
        InputError: the frame has no such object.
    """
    run = branch.run
    k = min(look.k, run.length)
    at = run.iterations[k - 1] if k else None
    is_answer = look.answer and run.is_done and k == run.length > 0 and look.stage is None and look.edited is None
    names = [s.name for s in at.stages] if at is not None else []
    is_partial = not is_answer and look.stage in names[:-1]
    state = run.state_at(k - 1) if is_partial else run.state_scored_at(k) if not is_answer else run.final_state
    targets = {t.instance.instance_id: t for t in run.problem.targets}
    focus = look.obj
    if focus is None:
        focus = (
            at.instance_id
            if at
            else next((i for i, t in targets.items() if t.instance.hypotheses), next(iter(targets)))
        )
    if focus not in targets:
        raise InputError(unknown("object", focus, [*targets]))
    target = targets[focus]
    iteration = next((i for i in reversed(run.iterations[:k]) if i.instance_id == focus), None)
    own = state_of(state, target)
    objects = _objects(branch, state, k, is_answer, look.stage if is_partial else None)
    answer = next(o.answer for o in objects if o.instance_id == focus)
    arm = _arm(look, (answer if is_answer else None) or iteration, own)
    poses = _poses(target, iteration, own, arm, look, iteration is at, answer if is_answer else None)
    if look.edited is None and look.stage is None and not is_answer:
        for edit in run.edits:
            if (edit.after_iteration, edit.instance) == (k, focus):
                poses["edited"] = pose_matrix(edit.T_cam_obj)
    if is_answer and answer is not None and own is not None and (rival := runner_up(branch, own, answer)) is not None:
        poses["runner-up"] = rival.T_cam_obj
    return Moment(branch, k, target, iteration, is_answer, poses, arm, own, objects)


def state_of(state: Any, target: Target) -> Any:
    """Return the method's state of one object; None where it has no hypothesis."""
    ids = [t.instance.instance_id for t in state.problem.targets]
    return state.objects[ids.index(target.instance.instance_id)]


def labels_of(problem: Problem) -> dict[int, str]:
    """Name the objects by instance_id; where one is there twice, with the instance."""
    often = Counter(i.obj_id for i in problem.instances)
    return {
        i.instance_id: problem.models[i.obj_id].name + (f" #{i.instance_id}" if often[i.obj_id] > 1 else "")
        for i in problem.instances
    }


def color_of(index: int) -> RGB:
    """Return the colour of the instance at that place of ``problem.instances``."""
    return OBJECT_COLORS[index % len(OBJECT_COLORS)]


def clusters_of(branch: Branch) -> tuple[tuple[int, ...], ...]:
    """Return the clusters in which objects are solved; each object alone where the method does not know others."""
    problem = branch.run.problem
    ids = [i.instance_id for i in problem.instances]
    if not method_of(branch.settings.method.name).knows_others:
        return tuple((i,) for i in ids)
    clusters = tuple(tuple(i for i in cluster if i in ids) for cluster in problem.clusters)
    missing = set(ids) - {i for cluster in clusters for i in cluster}
    return (*filter(None, clusters), *((i,) for i in sorted(missing)))


def _objects(branch: Branch, state: Any, k: int, is_answer: bool, stage: str | None) -> tuple[SceneObject, ...]:
    """Return every object; ``stage``: up to which iteration k is shown, None = all of it."""
    problem, iterations = branch.run.problem, branch.run.iterations
    at = iterations[k - 1] if k and not is_answer else None
    spent = Counter(i.instance_id for i in iterations[:k])
    answers = {t.instance.instance_id: best for t, best in zip(problem.targets, state.best, strict=True)}
    labels, ids = labels_of(problem), [i.instance_id for i in problem.instances]
    stands = {p.instance_id: p.T_cam_obj for p in at.placed} if at else {}
    if at is not None:
        stands |= {p.instance_id: p.T_cam_obj for p in at.tree.rollout} if at.tree else {}
        reached = next((s for s in at.stages if s.name == stage), None)
        stands[at.instance_id] = (reached or at.accepted_stage).T_cam_obj
    objects = []
    for cluster in clusters_of(branch):
        for i in cluster:
            answer = answers[i]
            phase: Phase = "done" if is_answer and answer else _phase(i, cluster, at, spent[i], answer)
            pose = stands.get(i, answer.T_cam_obj if answer else None)
            objects.append(SceneObject(problem.target(i), labels[i], color_of(ids.index(i)), phase, answer, pose))
    return tuple(objects)


def _phase(instance_id: int, cluster: Sequence[int], at: Iteration | None, spent: int, answer: Best | None) -> Phase:
    if answer is None:
        return "no pose"
    if at is None:
        return "waiting"
    if instance_id == at.instance_id:
        return "working"
    if instance_id in {p.instance_id for p in at.placed}:
        return "placed"
    if at.tree is not None and instance_id in {p.instance_id for p in at.tree.rollout}:
        return "rolled out"
    takes_turns = at.scene_pass is not None or at.tree is not None
    return "waiting" if spent == 0 or (takes_turns and at.instance_id in cluster) else "done"


def _arm(look: Look, shown: Iteration | Best | None, own: Any) -> int:
    if own is None:
        return 0
    if look.arm is not None:
        return min(look.arm, len(own.arms) - 1)
    return shown.arm if shown is not None else own.best.arm


def _poses(
    target: Target, iteration: Iteration | None, own: Any, arm: int, look: Look, is_at: bool, answer: Best | None
) -> dict[str, Float]:
    """Return the poses by stage; ``is_at``: whether the iteration is the one looked at, which a stage may cut short."""
    poses: dict[str, Float] = {}
    if own is not None:
        poses["initial"] = own.arms[arm].entries[0].T_cam_obj
    if answer is None and iteration is not None:
        names = [s.name for s in iteration.stages]
        n = names.index(look.stage) + 1 if is_at and look.stage in names else len(names)
        poses |= {s.name: s.T_cam_obj for s in iteration.stages[:n]}
        if n == len(names):
            poses["accepted"] = iteration.accepted_stage.T_cam_obj
    elif answer is None and own is not None:
        poses["current"] = own.arms[arm].current.T_cam_obj
    best = answer or (own.best if own is not None else None)
    if best is not None:
        poses["best"] = best.T_cam_obj
    if look.edited is not None:
        poses["edited"] = pose_matrix(look.edited)
    if target.instance.T_cam_obj_gt is not None:
        poses["ground truth"] = target.instance.T_cam_obj_gt
    return poses


def runner_up(branch: Branch, own: Any, best: Best) -> Best | None:
    """Return the best pose of another hypothesis; None where the method does not answer with the best of all."""
    if not method_of(branch.settings.method.name).answers_best_of_all:
        return None
    others = [entry.as_best(j) for j, arm in enumerate(own.arms) if j != best.arm for entry in arm.entries]
    return max(others, key=lambda pose: pose.score.score, default=None)


def pose_matrix(values: Sequence[float]) -> Float:
    """Return a pose that came from a browser, made rigid.

    Raises:
        ShapeError: it is no rigid pose.
    """
    return as_rigid(np.array(values, float).reshape(4, 4), "pose")
