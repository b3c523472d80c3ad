"""Every object of the frame at one moment of a run: where it stands, how well, and whether its turn has come."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import OBJECT_COLORS, RGB
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.records import Best, Iteration, SceneRecord
from verefine_viz.evaluation.pose_errors import PoseErrors

Phase = Literal["waiting", "working", "placed", "rolled out", "done", "no pose"]
Errors = Callable[[Target, Float], PoseErrors | None]


@dataclass(frozen=True, eq=False)
class ObjectState:
    """One object at the cursor."""

    target: Target
    label: str
    """Its name, with the instance where an object is there twice."""
    color: RGB
    cluster: int
    """From 1."""
    order: int
    """From 1, over the whole frame."""
    phase: Phase
    """waiting: its turn (in this pass) is still to come. working: the iteration at the cursor is about it. placed: it
    stood in the scene in that iteration. rolled out: a tree search completed the scene with it. done: it has used its
    budget, or the run is over. no pose: it has no hypothesis."""
    answer: Best | None
    """The answer so far; for methods that keep a best scene, its pose in that."""
    T_cam_obj: Float | None
    """Where it stands in this iteration; the answer where it takes no part in it."""
    errors: PoseErrors | None
    """Of the answer."""
    n_iterations: int
    """Spent on it up to the cursor."""

    @property
    def instance_id(self) -> int:
        return self.target.instance.instance_id

    @property
    def placed(self) -> Placed | None:
        """The model where it stands."""
        if self.T_cam_obj is None:
            return None
        return Placed(self.instance_id, self.target.model, self.T_cam_obj)


@dataclass(frozen=True, eq=False)
class ClosedPass:
    """A pass over the objects of a cluster that came to its end."""

    iteration: int
    number: int
    cluster: int
    """From 1."""
    record: SceneRecord
    best_pass: int
    """Of this cluster, up to here, in which the incumbent was found; 0 = the initial poses."""


@dataclass(frozen=True, eq=False)
class SceneState:
    """All objects at the cursor."""

    objects: tuple[ObjectState, ...]
    """In the order to solve them."""
    n_clusters: int
    closed: tuple[ClosedPass, ...]
    """All passes of the history that are closed, also after the cursor."""
    cursor: int
    is_answer: bool = False
    """Whether every object stands where the finished run left it."""

    def object(self, instance_id: int) -> ObjectState:
        """The object of that instance."""
        return next(o for o in self.objects if o.instance_id == instance_id)

    @property
    def latest_pass(self) -> ClosedPass | None:
        """The last pass closed at the cursor, or before it."""
        return next((p for p in reversed(self.closed) if p.iteration <= self.cursor), None)

    @property
    def closes_pass(self) -> ClosedPass | None:
        """The pass that the iteration at the cursor closes."""
        latest = self.latest_pass
        return latest if latest is not None and latest.iteration == self.cursor else None


def scene_state(
    problem: Problem,
    state: Any,
    iterations: Sequence[Iteration],
    cursor: int,
    errors: Errors,
    alone: bool = False,
    is_answer: bool = False,
    stage: str | None = None,
) -> SceneState:
    """The scene at iteration ``cursor``.

    Args:
        problem: the frame.
        state: the method's state at the cursor; its ``best`` is the answer so far.
        iterations: the whole history.
        cursor: 0 = before the first.
        errors: errors of a pose against ground truth.
        alone: whether the method solves every object for itself, in the order of the frame.
        is_answer: whether the run is over and shows its answer instead of its last iteration.
        stage: up to which the iteration at the cursor is shown; None = all of it.
    """
    at = iterations[cursor - 1] if cursor and not is_answer else None
    spent = Counter(i.instance_id for i in iterations[:cursor])
    answers = {t.instance.instance_id: best for t, best in zip(problem.targets, state.best, strict=True)}
    labels = labels_of(problem)
    ids = [i.instance_id for i in problem.instances]
    stands = {p.instance_id: p.T_cam_obj for p in at.placed} if at else {}
    if at is not None:
        stands |= {p.instance_id: p.T_cam_obj for p in at.tree.rollout} if at.tree else {}
        reached = next((s for s in at.stages if s.name == stage), None)
        stands[at.instance_id] = (reached or at.accepted_stage).T_cam_obj
    objects = []
    clusters = tuple((i,) for i in ids) if alone else clusters_of(problem)
    for k, cluster in enumerate(clusters, 1):
        for instance_id in cluster:
            target, answer = problem.target(instance_id), answers[instance_id]
            pose = stands.get(instance_id, answer.T_cam_obj if answer else None)
            objects.append(
                ObjectState(
                    target,
                    labels[instance_id],
                    color_of(ids.index(instance_id)),
                    k,
                    len(objects) + 1,
                    "done" if is_answer and answer else _phase(instance_id, cluster, at, spent[instance_id], answer),
                    answer,
                    pose,
                    errors(target, answer.T_cam_obj) if answer else None,
                    spent[instance_id],
                )
            )
    return SceneState(tuple(objects), len(clusters), closed_passes(iterations, clusters), cursor, is_answer)


def clusters_of(problem: Problem) -> tuple[tuple[int, ...], ...]:
    """The clusters to show: without a dependency graph all objects in the order of the frame, each alone."""
    known = {i.instance_id for i in problem.instances}
    clusters = tuple(tuple(i for i in cluster if i in known) for cluster in problem.clusters)
    missing = known - {i for cluster in clusters for i in cluster}
    return (*filter(None, clusters), *((i,) for i in sorted(missing)))


def labels_of(problem: Problem) -> dict[int, str]:
    """Names by instance_id; where an object is there twice, with the instance."""
    often = Counter(i.obj_id for i in problem.instances)
    return {
        i.instance_id: problem.models[i.obj_id].name + (f" #{i.instance_id}" if often[i.obj_id] > 1 else "")
        for i in problem.instances
    }


def color_of(index: int) -> RGB:
    """The colour of the instance at that place of ``problem.instances``."""
    return OBJECT_COLORS[index % len(OBJECT_COLORS)]


def closed_passes(iterations: Sequence[Iteration], clusters: Sequence[Sequence[int]]) -> tuple[ClosedPass, ...]:
    """The passes that were closed, in order."""
    found: list[ClosedPass] = []
    best: dict[int, tuple[float, int]] = {}
    for iteration in iterations:
        if iteration.scene is None:
            continue
        k = next((k for k, c in enumerate(clusters, 1) if iteration.instance_id in c), 1)
        number, highest = iteration.scene_pass or 0, iteration.scene.incumbent_score
        known, at = best.get(k, (_before(iteration.scene), 0))
        if highest > known:
            at = number
        best[k] = (highest, at)
        found.append(ClosedPass(iteration.index, number, k, iteration.scene, at))
    return tuple(found)


def _before(record: SceneRecord) -> float:
    """The incumbent's score before the first pass, as far as its record says: the initial poses, or better."""
    seen = max(record.score.score, record.best_known.score)
    return float("-inf") if record.incumbent_score == seen else record.incumbent_score


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
