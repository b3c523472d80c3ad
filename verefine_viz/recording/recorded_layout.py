"""What drawing needs to know of a problem: small enough to be part of the recording itself."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.palette import OBJECT_COLORS, RGB
from verefine_viz.core.problem import Problem
from verefine_viz.core.protocols import RunState
from verefine_viz.core.records import Iteration
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import Session
from verefine_viz.methods.registry import method_of
from verefine_viz.recording.entities import WORKED_ON, branch

SUBSAMPLE = 16
"""Every so many-th point gives the middle and the reach of the objects."""


@dataclass(frozen=True)
class Branch:
    """One object's part of the recording."""

    instance_id: int
    obj_id: int
    name: str
    """Of its entities: ``3_mug``."""
    sources: tuple[str, ...]
    """Where each hypothesis comes from."""
    initial: tuple[tuple[float, ...], ...]
    """Of each hypothesis before the first iteration: f̄, mean f_d, mean f_n, N, rendered pixels, the five classes."""
    has_truth: bool

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[0-9]+_[A-Za-z0-9_-]+", self.name):
            raise ValueError(f"{self.name!r} is no name of an object's entities, expected one such as 3_mug")
        if len(self.initial) != len(self.sources) or any(len(row) != len(_UNKNOWN) for row in self.initial):
            raise ValueError(
                f"the initial scores of {self.name} are not {len(_UNKNOWN)} numbers for each of its"
                f" {len(self.sources)} hypotheses"
            )

    @property
    def n_arms(self) -> int:
        return len(self.sources)

    @property
    def initial_scores(self) -> tuple[float, ...]:
        """f̄ of each hypothesis before the first iteration."""
        return tuple(values[0] for values in self.initial)


@dataclass(frozen=True)
class Layout:
    """All objects of the recorded problem, in order."""

    branches: tuple[Branch, ...]
    center_world: tuple[float, float, float]
    """What the 3D view looks at: the middle of the objects [m]."""
    eye_world: tuple[float, float, float]
    """From where: near the camera, a little to the side [m]."""
    width_m: float
    """How far apart the objects reach on the table, along the world's x or y."""
    method: str
    has_graph: bool
    """Whether it has a dependency graph."""
    has_clusters: bool
    """Whether some objects are solved together."""
    has_flips: bool = False
    """Whether flips of promising poses may compete with them."""

    def __post_init__(self) -> None:
        if len({b.instance_id for b in self.branches}) < len(self.branches):
            raise ValueError("an object is in it twice")
        if not np.isfinite([*self.center_world, *self.eye_world, self.width_m]).all():
            raise ValueError("where the 3D view looks at is not a number")

    @property
    def is_scene(self) -> bool:
        """Whether there is more than one object."""
        return len(self.branches) > 1

    @property
    def has_passes(self) -> bool:
        """Whether iterations of several objects are scored together."""
        return method_of(self.method).has_passes and self.is_scene and self.has_clusters

    @property
    def has_tree(self) -> bool:
        """Whether the iterations grow a search tree."""
        return method_of(self.method).has_tree

    @property
    def has_choice(self) -> bool:
        """Whether the method chooses between hypotheses."""
        return method_of(self.method).chooses

    @property
    def has_ground_truth(self) -> bool:
        """Whether that of any object is known."""
        return any(b.has_truth for b in self.branches)

    @property
    def worked_on(self) -> tuple[str, ...]:
        """Poses of the object being worked on that are drawn, in this order."""
        return (*WORKED_ON, "flipped") if self.has_flips else WORKED_ON

    @property
    def names(self) -> list[str]:
        """Of the branches."""
        return [b.name for b in self.branches]

    @property
    def colors(self) -> dict[int, RGB]:
        """Each object's colour, by instance."""
        return {b.instance_id: OBJECT_COLORS[k % len(OBJECT_COLORS)] for k, b in enumerate(self.branches)}

    def branch(self, instance_id: int) -> Branch:
        return next(b for b in self.branches if b.instance_id == instance_id)

    def check(self, iterations: Iterable[Iteration]) -> None:
        """
        Raises:
            ValueError: an iteration cannot be one of a run with these objects and hypotheses.
        """
        arms = {b.instance_id: b.n_arms for b in self.branches}
        n_nodes: dict[int, int] = {}
        """Of each cluster's search tree, so far."""
        for i in iterations:
            n_arms = arms.get(i.instance_id, 0)
            if i.arm not in range(n_arms):
                subject = f"hypothesis {i.arm + 1} of instance {i.instance_id}"
                raise ValueError(f"iteration {i.index} is about {subject}, which has {n_arms}")
            if i.stage(i.accepted) is None:
                raise ValueError(f"iteration {i.index} accepted its {i.accepted} pose, and has none")
            choice = () if i.choice is None else (i.choice.plays, i.choice.mean, i.choice.exploration, i.choice.ucb)
            if any(len(numbers) != n_arms for numbers in choice):
                raise ValueError(f"iteration {i.index} chose from another number of hypotheses than {n_arms}")
            if i.path is not None and not len(i.path.Ts_cam_obj):
                raise ValueError(f"the simulation of iteration {i.index} has no pose")
            unknown = set(_other_instances(i)) - arms.keys()
            if unknown:
                raise ValueError(f"iteration {i.index} places instance {min(unknown)}, which is not recorded")
            if i.tree is not None:
                n, node = n_nodes.get(i.tree.cluster, 1), i.tree.node
                if node is not None:
                    if node.node != n or node.parent not in range(n):
                        raise ValueError(f"iteration {i.index} adds node {node.node} to a search tree of {n} nodes")
                    n += 1
                if not all(number in range(n) for number in i.tree.branch):
                    raise ValueError(f"iteration {i.index} visits a node of the search tree that was never added")
                n_nodes[i.tree.cluster] = n

    def to_json(self) -> str:
        return json.dumps({**vars(self), "branches": [vars(b) for b in self.branches]}, separators=(",", ":"))


def layout_of(problem: Problem, state: RunState, session: Session) -> Layout:
    """The layout of a problem, given the state before the first iteration and what is being run."""
    branches: list[Branch] = []
    for instance, scores in zip(problem.instances, state.initial, strict=True):
        sources = tuple(h.source for h in instance.hypotheses)
        initial = [_UNKNOWN] * len(sources) if scores is None else _rows(scores)
        has_truth = instance.T_cam_obj_gt is not None
        name = branch(instance, problem)
        branches.append(Branch(instance.instance_id, instance.obj_id, name, sources, tuple(initial), has_truth))
    solved = {b.instance_id for b in branches if b.n_arms}
    has_clusters = any(len(solved.intersection(cluster)) > 1 for cluster in problem.clusters)
    has_graph, has_flips = problem.dependencies is not None, session.hypotheses.flips
    return Layout(tuple(branches), *_view(problem), session.method.name, has_graph, has_clusters, has_flips)


def _other_instances(iteration: Iteration) -> Iterator[int]:
    """Of all poses beside its stages that the iteration names."""
    scene, tree = iteration.scene, iteration.tree
    poses = [*iteration.placed]
    if scene is not None:
        poses += [*scene.poses, *scene.incumbent]
    if tree is not None:
        poses += [*tree.rollout, *tree.incumbent]
        if tree.node is not None:
            yield tree.node.instance_id
    yield from (pose.instance_id for pose in poses)


_UNKNOWN = (0.0,) * 10


def _rows(scores: Scores) -> list[tuple[float, ...]]:
    """As ``Branch.initial``."""
    fits, pixels = (scores.score, scores.depth_fit, scores.normal_fit), (scores.n_pixels, scores.n_rendered)
    return [tuple(row) for row in np.column_stack((*fits, *pixels, scores.counts)).tolist()]


def _view(problem: Problem) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    """Center, eye and width of :class:`Layout`."""
    T_world_cam = world_from_camera(problem.observation)
    clouds = [i.points_cam[::SUBSAMPLE] for i in problem.instances if len(i.points_cam)]
    points = apply(T_world_cam, np.concatenate(clouds or [[[0.0, 0.0, 1.0]]]))
    # Masks leak: a few points far behind must not decide where to look.
    few = len(points) // 20
    ends = (few, len(points) - 1 - few)
    low, high = np.partition(points, ends, axis=0)[ends, :]
    center = (low + high) / 2
    to_camera = 0.75 * (T_world_cam[:3, 3] - center)
    eye = center + _ASIDE @ to_camera
    return (center[0], center[1], center[2]), (eye[0], eye[1], eye[2]), float((high - low)[:2].max())


_ASIDE = axis_angle([0, 0, 1], np.radians(25))


def world_from_camera(observation: Observation) -> Float:
    """T_world_cam; without a support plane the camera is taken to be level, at the origin."""
    support = observation.support
    return support.T_world_cam if support else transform(axis_angle([1, 0, 0], -np.pi / 2), [0, 0, 0])
