"""What drawing needs to know of a problem: names, colours, where to look from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.palette import OBJECT_COLORS, RGB
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.methods.known_methods import method_of
from verefine_viz.recording.entities import WORKED_ON, branch
from verefine_viz.run.record import RunHeader

SUBSAMPLE = 16
"""Every so many-th point gives the middle and the reach of the objects."""


@dataclass(frozen=True)
class ObjectBranch:
    """One object's part of the recording."""

    instance_id: int
    name: str
    """Name of its entities: ``3_mug``."""
    sources: tuple[str, ...]
    """Where each hypothesis comes from."""
    initial_scores: tuple[float, ...]
    """f̄ of each hypothesis before the first iteration."""
    has_truth: bool

    @property
    def n_arms(self) -> int:
        return len(self.sources)


@dataclass(frozen=True)
class Layout:
    """All objects of the recorded problem, in order."""

    branches: tuple[ObjectBranch, ...]
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
        """Names of the branches."""
        return [b.name for b in self.branches]

    @property
    def colors(self) -> dict[int, RGB]:
        """Each object's colour, by instance."""
        return {b.instance_id: OBJECT_COLORS[k % len(OBJECT_COLORS)] for k, b in enumerate(self.branches)}

    def branch(self, instance_id: int) -> ObjectBranch:
        return next(b for b in self.branches if b.instance_id == instance_id)


def layout_of(problem: Problem, header: RunHeader, session: Session) -> Layout:
    """The layout of a run of ``session``."""
    branches = tuple(
        ObjectBranch(
            one.instance_id,
            branch(instance, problem),
            tuple(h.source for h in one.hypotheses),
            tuple(score.score for score in one.initial),
            one.T_cam_obj_gt is not None,
        )
        for instance, one in zip(problem.instances, header.objects, strict=True)
    )
    solved = {b.instance_id for b in branches if b.n_arms}
    has_clusters = any(len(solved.intersection(cluster)) > 1 for cluster in problem.clusters)
    has_graph, has_flips = problem.dependencies is not None, session.hypotheses.flips
    return Layout(branches, *_view(problem), session.method.name, has_graph, has_clusters, has_flips)


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
