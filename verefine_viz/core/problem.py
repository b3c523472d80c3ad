"""The problem that a method solves: a frame, its instances with their hypotheses, and how they depend on each other
(docs/methods.md 2).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from verefine_viz.core.arrays import Float, Mask, finite, frozen, set_fields
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation

EdgeKind = Literal["contact", "occlusion", "support"]
EdgeState = Literal["used", "ambiguous", "cut"]


@dataclass(frozen=True)
class Edge:
    """Two instances that interact, with the evidence."""

    kind: EdgeKind
    """contact: they may touch. occlusion: ``first`` hides part of ``second``. support: ``first`` supports
    ``second``."""
    first: int
    """instance_id; the lower of the two for contact."""
    second: int
    strength: float
    """Strength in [0, 1]; the weakest edge of a cycle is left out."""
    evidence: str
    """With numbers and units: "5 mm apart", "64 % of its footprint, 2 mm above"."""
    state: EdgeState = "used"
    """ambiguous: part of a cycle and its weakest edge, so left out of the order. cut: left out by the user,
    or between two clusters of `cuthill_mckee`."""


@dataclass(frozen=True)
class DependencyGraph:
    """The dependencies of a frame's instances: edges, and the order that follows."""

    edges: tuple[Edge, ...]
    clusters: tuple[tuple[int, ...], ...]
    """Groups of instances that may interact, front to back; each in the order to solve it: a supporter comes before
    what rests on it. Every instance of the problem appears once."""
    support_lists: tuple[tuple[int, ...], ...]
    """Groups of a base object and what rests on it, in the order of ``clusters``."""
    source: Literal["recommended", "published", "given"]
    notes: tuple[str, ...] = ()
    """Notes for the user: cycles, ids in a given order that are not in the frame, …"""

    @property
    def order(self) -> tuple[int, ...]:
        """All instances in the order to solve them."""
        return tuple(i for cluster in self.clusters for i in cluster)

    def cluster_of(self, instance_id: int) -> int:
        """Index of the instance's cluster."""
        return next(k for k, cluster in enumerate(self.clusters) if instance_id in cluster)

    def only(self, instance_ids: Collection[int]) -> DependencyGraph:
        """The graph without the other instances; a cluster may get smaller, but is not split."""
        clusters = tuple(tuple(i for i in cluster if i in instance_ids) for cluster in self.clusters)
        lists = tuple(tuple(i for i in supported if i in instance_ids) for supported in self.support_lists)
        edges = tuple(e for e in self.edges if e.first in instance_ids and e.second in instance_ids)
        return replace(
            self, edges=edges, clusters=tuple(filter(None, clusters)), support_lists=tuple(filter(None, lists))
        )


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One initial pose of one instance: an arm of the bandit."""

    T_cam_obj: Float
    """(4, 4) [m]."""
    confidence: float
    """The estimator's own score; only its order matters."""
    source: str
    """Origin of the pose, as shown to the user: "cosypose", "perturbed 30° 30 mm #3", …"""
    tracked_from: str = ""
    """The earlier frame whose answer it is; "" = none."""

    def __post_init__(self) -> None:
        set_fields(self, T_cam_obj=as_rigid(self.T_cam_obj, f"hypothesis ({self.source})"))


SAME_POSE = 1e-5
"""Largest difference of the numbers of two poses that are one pose, rounded by a program."""
ANSWER = "answer"
"""Name of the recorded step with which a program ends."""


@dataclass(frozen=True, eq=False)
class RecordedStep:
    """A step that another program's refiner took with one hypothesis, as it was recorded."""

    hypothesis: int
    """Index into the instance's hypotheses."""
    T_cam_obj: Float
    """(4, 4) where the step took it [m]."""
    name: str = "refined"
    """What the program calls the step."""
    score: float | None = None
    """Score by the program, in its own units."""
    ms: float = 0.0
    """How long it took [ms]; 0 = unknown."""
    note: str = ""

    def __post_init__(self) -> None:
        set_fields(self, T_cam_obj=as_rigid(self.T_cam_obj, f"recorded pose ({self.name})"))


@dataclass(frozen=True, eq=False)
class Instance:
    """One object in the frame."""

    instance_id: int
    """Index in the frame; equals BOP's gt_id where masks come from the data set."""
    obj_id: int
    mask: Mask
    """(H, W) its visible pixels."""
    points_cam: Float
    """(N, 3) its observed cloud, subsampled with a seed [m]; empty where the mask holds no depth."""
    hypotheses: tuple[Hypothesis, ...]
    """Best first; may be empty."""
    T_cam_obj_gt: Float | None = None
    """(4, 4) ground truth, or None."""
    visib_fract: float | None = None
    """Visible share of its silhouette, in [0, 1], where the data set says."""
    recorded: tuple[RecordedStep, ...] = ()
    """What another program did to its hypotheses, in order; method ``trace`` repeats it."""
    recorded_scores: tuple[float | None, ...] = ()
    """That program's own scores of the hypotheses, where it recorded any steps."""

    def __post_init__(self) -> None:
        set_fields(
            self,
            mask=frozen(self.mask, "mask", (None, None), bool),
            points_cam=finite(self.points_cam, "observed cloud", (None, 3)),
        )
        if self.T_cam_obj_gt is not None:
            set_fields(self, T_cam_obj_gt=as_rigid(self.T_cam_obj_gt, "ground-truth pose"))

    def __repr__(self) -> str:
        return f"<Instance {self.instance_id} of object {self.obj_id}: {len(self.points_cam)} points>"

    def recorded_score(self, T_cam_obj: Float) -> float | None:
        """The last score of this pose (4, 4) by the other program; None where it gave none."""
        scored = [(step.T_cam_obj, step.score) for step in reversed(self.recorded)]
        scored += [(h.T_cam_obj, s) for h, s in zip(self.hypotheses, self.recorded_scores, strict=False)]
        same = (s for T, s in scored if s is not None and np.abs(T - T_cam_obj).max() < SAME_POSE)
        return next(same, None)


@dataclass(frozen=True)
class LeftOut:
    """An object that is in the frame and not among the instances to solve: its mask or its model cannot be used."""

    instance_id: int | None
    """The instance_id; None where masks are detections, as this object has none."""
    obj_id: int
    name: str
    why: str
    """What is missing, as shown to the user."""
    has_truth: bool
    """Whether its ground-truth pose is known."""
    visib_fract: float | None = None
    is_unreadable: bool = False
    """Whether a file of it is missing or damaged, which can be mended; else there is none to mend."""


@dataclass(frozen=True, eq=False)
class Target:
    """One instance with all that is needed to fit its model to the frame."""

    observation: Observation
    instance: Instance
    model: ObjectModel

    def __repr__(self) -> str:
        return f"<Target {self.model.name} (#{self.instance.instance_id}): {len(self.instance.hypotheses)} hypotheses>"

    def left_out(self, why: str, is_unreadable: bool = False) -> LeftOut:
        """The object as one that cannot be solved."""
        i, has_truth = self.instance, self.instance.T_cam_obj_gt is not None
        return LeftOut(i.instance_id, i.obj_id, self.model.name, why, has_truth, i.visib_fract, is_unreadable)


@dataclass(frozen=True, eq=False)
class Placed:
    """A model at a pose: what is simulated, rendered, or stands in the way."""

    instance_id: int
    model: ObjectModel
    T_cam_obj: Float
    """(4, 4) [m]."""


@dataclass(frozen=True, eq=False)
class Problem:
    """One frame and the instances to be solved in it."""

    scene_id: int
    im_id: int
    observation: Observation
    models: Mapping[int, ObjectModel]
    """By obj_id."""
    instances: tuple[Instance, ...]
    title: str = ""
    """As shown to the user: data set or demo scene."""
    notes: tuple[str, ...] = ()
    """Notes about the data, for the user: units guessed, masks missing, …"""
    left_out: tuple[LeftOut, ...] = ()
    """Objects that are in the frame but cannot be solved; they count as missed."""
    dependencies: DependencyGraph | None = None
    """None: not analysed; every instance is then a cluster of its own, in the order of ``instances``."""
    order: tuple[tuple[int, ...], ...] = ()
    """Clusters of instance ids, in the order to solve them, that came with the frame; empty where none did."""

    def __repr__(self) -> str:
        names = ", ".join(self.models[i.obj_id].name for i in self.instances)
        return f"<Problem {self.frame}: {names or 'no object'}>"

    @cached_property
    def targets(self) -> tuple[Target, ...]:
        """One per instance, in order; the same objects at each access."""
        return tuple(Target(self.observation, i, self.models[i.obj_id]) for i in self.instances)

    @property
    def clusters(self) -> tuple[tuple[int, ...], ...]:
        """Instance ids of each cluster, in the order to solve them."""
        if self.dependencies is None:
            return tuple((i.instance_id,) for i in self.instances)
        return self.dependencies.clusters

    def target(self, instance_id: int) -> Target:
        """The target of that instance.

        Raises:
            InputError: it is not in this frame.
        """
        for target in self.targets:
            if target.instance.instance_id == instance_id:
                return target
        raise InputError(unknown("instance", instance_id, [i.instance_id for i in self.instances]))

    @property
    def frame(self) -> str:
        """``scene/image``, as session files write it."""
        return f"{self.scene_id}/{self.im_id}"

    def only(self, instance_ids: Collection[int]) -> Problem:
        """The frame with fewer instances to solve (the observation keeps all masks).

        Raises:
            InputError: an id is not in this frame.
        """
        available = [i.instance_id for i in self.instances]
        for wanted in instance_ids:
            if wanted not in available:
                raise InputError(f"{unknown('instance', wanted, available)} (frame {self.frame})")
        instances = tuple(i for i in self.instances if i.instance_id in instance_ids)
        dependencies = self.dependencies.only(instance_ids) if self.dependencies else None
        order = tuple(tuple(i for i in cluster if i in instance_ids) for cluster in self.order)
        return replace(self, instances=instances, dependencies=dependencies, order=order)
