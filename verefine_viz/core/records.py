"""What every iteration leaves behind: enough to redraw it without running anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, finite, frozen
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.scores import PoseScore


@dataclass(frozen=True, eq=False)
class Contacts:
    """Where a simulated object touches something, at one step."""

    points_cam: Float
    """(n, 3) [m]."""
    normals_cam: Float
    """(n, 3) unit, pointing onto the moving object."""
    depths_m: Float
    """(n,) penetration, positive = overlapping [m]."""
    forces_n: Float
    """(n,) normal force [N]."""
    others: NDArray[np.int64]
    """(n,) instance_id of what is touched; −1 is the support, less an unknown object (``core/surroundings.py``)."""

    def __post_init__(self) -> None:
        n = len(self.depths_m)
        object.__setattr__(self, "points_cam", finite(self.points_cam, "contact points", (n, 3)))
        object.__setattr__(self, "normals_cam", finite(self.normals_cam, "contact normals", (n, 3)))
        object.__setattr__(self, "depths_m", finite(self.depths_m, "contact depths", (n,)))
        object.__setattr__(self, "forces_n", finite(self.forces_n, "contact forces", (n,)))
        object.__setattr__(self, "others", frozen(self.others, "contact partners", (n,), np.int64))

    def split(self, ends: Sequence[int]) -> tuple[Contacts, ...]:
        """One record per step, of the contacts of all steps one after another: up to each of ``ends``, from the last.

        Made without another check, as their columns are parts of columns that are checked already.
        """
        parts: list[Contacts] = []
        for first, end in pairwise((0, *ends)):
            part = object.__new__(Contacts)
            part.__dict__.update({name: column[first:end] for name, column in self.__dict__.items()})
            parts.append(part)
        return tuple(parts)


@dataclass(frozen=True)
class Tipping:
    """That a simulated object does not stand: it touches something, and its centre of mass is not supported."""

    overhang_m: float
    """Distance of the centre of mass to what supports the object, seen along gravity [m]."""
    step: int
    """1, 2, …: at the end of which step. The last one, or the first that touched where it fell over until the end."""


@dataclass(frozen=True, eq=False)
class SimulatedPath:
    """What physics did to an object, pose by pose."""

    Ts_cam_obj: Float
    """(S + 1, 4, 4): the start, then one pose per step [m]."""
    contacts: tuple[Contacts, ...]
    """One per step, S of them: contacts at the end of the step."""
    tipping: Tipping | None = None
    """None: it stands, falls freely, or sinks in too deep to decide."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "Ts_cam_obj", finite(self.Ts_cam_obj, "simulated path", (None, 4, 4)))

    @property
    def T_cam_obj(self) -> Float:
        """The last pose (4, 4)."""
        return self.Ts_cam_obj[-1]


TIMING = {"timing": True}
"""Metadata of fields that differ from run to run and are left out of comparisons."""

StageName = Literal["initial", "current", "simulated", "mixed", "refined", "flipped", "edited"]

EventKind = Literal[
    "kept_simulated",
    "kept_refined",
    "flipped",
    "score_fell",
    "new_best",
    "arm_switched",
    "unstable",
    "physics_worse",
    "empty_render",
    "nan_score",
    "refiner_stuck",
    "no_physics",
    "edited",
    "new_best_scene",
]


@dataclass(frozen=True, eq=False)
class Stage:
    """One pose on the way through an iteration."""

    name: StageName
    T_cam_obj: Float
    score: PoseScore | None = None
    """None where the method has no reason to score it (the mixed pose only starts the refiner)."""
    ms: float = field(default=0.0, metadata=TIMING)
    """Time it took to compute the pose [ms]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_cam_obj", as_rigid(self.T_cam_obj, f"{self.name} pose"))

    def with_score(self, score: PoseScore | None) -> Stage:
        """The same with its score; made without checking the pose again."""
        stage = object.__new__(Stage)
        stage.__dict__.update(self.__dict__, score=score)
        return stage


@dataclass(frozen=True, eq=False)
class Choice:
    """The bandit's numbers as they were when it chose."""

    arm: int
    plays: Float
    """(H,) n_j, discounted where the policy discounts."""
    mean: Float
    """(H,) μ_j."""
    exploration: Float
    """(H,) c·sqrt(ln Σn / n_j)."""
    ucb: Float
    """(H,) mean + exploration."""
    reason: str
    """One sentence: "arm 3: 0.71 + 0.09 > arm 1: 0.74 + 0.05"."""

    def __post_init__(self) -> None:
        for name in ("plays", "mean", "exploration", "ucb"):
            object.__setattr__(self, name, frozen(getattr(self, name), name, (None,)))


@dataclass(frozen=True, eq=False)
class Best:
    """The answer for one object, so far."""

    T_cam_obj: Float
    score: PoseScore
    arm: int
    iteration: int
    """0 = an initial pose."""
    stage: StageName

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_cam_obj", as_rigid(self.T_cam_obj, "best pose"))


@dataclass(frozen=True, eq=False)
class Event:
    """Something about an iteration that gets a mark on the timeline."""

    kind: EventKind
    text: str
    """One sentence with numbers and units."""


@dataclass(frozen=True, eq=False)
class PlacedPose:
    """An object that stood in the scene while another was worked on."""

    instance_id: int
    T_cam_obj: Float

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_cam_obj", as_rigid(self.T_cam_obj, f"placed pose of instance {self.instance_id}"))


@dataclass(frozen=True, eq=False)
class SceneRecord:
    """What closes a pass over the objects of a cluster: how well their poses explain the scene together."""

    poses: tuple[PlacedPose, ...]
    """Of this pass, in dependency order."""
    score: PoseScore
    """Scene score of this pass."""
    best_known: PoseScore
    """Scene score of each object's best pose so far, put together."""
    reward: float
    """What the arms that were chosen in this pass got."""
    incumbent: tuple[PlacedPose, ...]
    """The combination with the highest scene score ever seen."""
    incumbent_score: float


@dataclass(frozen=True, eq=False)
class TreeNode:
    """One node of a search tree: an object placed from one of its hypotheses, after those of the nodes above."""

    node: int
    """0 is the root, in which nothing is placed; numbered as they came about."""
    parent: int
    instance_id: int
    arm: int
    lcp: float
    """Share of the model's points that the segment explains at the hypothesis, in [0, 1]: what was tried first."""
    T_cam_obj: Float
    """After refinement and simulation."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_cam_obj", as_rigid(self.T_cam_obj, f"pose of tree node {self.node}"))


@dataclass(frozen=True, eq=False)
class TreeStep:
    """What one iteration did to the search tree. The tree is what all steps so far add up to."""

    cluster: int
    """Each cluster has a tree of its own, with nodes numbered from 0."""
    branch: tuple[int, ...]
    """Nodes from the root to the one visited, which is the new one unless the tree is complete there."""
    node: TreeNode | None
    """The node that was added; None where the branch was expanded to its end before."""
    choices: tuple[str, ...]
    """Why each node of the branch after the root was chosen, in words."""
    rollout: tuple[PlacedPose, ...]
    """The rest of the scene as it was completed, object by object."""
    rollout_arms: tuple[int, ...]
    cost_px: float
    """Pixels of the complete scene that are not explained; added to every node of the branch, with one visit."""
    incumbent: tuple[PlacedPose, ...]
    """The complete scene with the lowest cost ever seen."""
    incumbent_cost_px: float


@dataclass(frozen=True, eq=False)
class Iteration:
    """One step of a method."""

    index: int
    """1, 2, … over the whole run."""
    instance_id: int
    obj_id: int
    arm: int
    """Index of the hypothesis that was worked on."""
    arm_iteration: int
    """1, 2, … for this arm."""
    stages: tuple[Stage, ...]
    """In the order they came about; "current" first."""
    accepted: StageName
    """The stage that the next iteration of this arm starts from."""
    best: Best
    """Best of this object after this iteration."""
    path: SimulatedPath | None = None
    choice: Choice | None = None
    """None for methods that do not choose between hypotheses."""
    events: tuple[Event, ...] = ()
    placed: tuple[PlacedPose, ...] = ()
    """Other objects that stood in the simulation, and in the score as what may hide, in the order they were placed."""
    scene_pass: int | None = None
    """vf_depth: 1, 2, … of its cluster."""
    scene: SceneRecord | None = None
    """Closes a pass, on the iteration of its last object."""
    tree: TreeStep | None = None
    """physim_mcts."""
    score_ms: float = field(default=0.0, metadata=TIMING)
    """Time the iteration waited for its scores [ms]; those worked out beside the refiner cost it none."""

    def stage(self, name: StageName) -> Stage | None:
        """The stage of that name, or None."""
        for stage in self.stages:
            if stage.name == name:
                return stage
        return None

    @property
    def before_refined(self) -> Stage | None:
        """Where the refiner began; None in an iteration without it."""
        return next((before for before, after in pairwise(self.stages) if after.name == "refined"), None)

    @property
    def accepted_stage(self) -> Stage:
        stage = self.stage(self.accepted)
        assert stage is not None, f"no {self.accepted} pose was made"
        return stage

    @property
    def ms(self) -> float:
        """Computing time of the whole iteration [ms]."""
        return sum(s.ms for s in self.stages) + self.score_ms
