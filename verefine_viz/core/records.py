"""Records of iterations: enough to redraw each without running anything.

Their content was checked where it came in (refiner, simulator, edits, files), and is not checked again.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.number_kinds import Id, Index, Real
from verefine_viz.core.scores import PoseScore

Number = Annotated[int, Meta(ge=1, le=2**31)]
"""A number counted from 1. Bounds are checked when a file is read."""


class Contacts(Struct, frozen=True, eq=False):
    """Contacts of a simulated object at one step."""

    points_cam: Float
    """(n, 3) positions [m]."""
    normals_cam: Float
    """(n, 3) unit, pointing onto the moving object."""
    depths_m: Float
    """(n,) penetration, positive = overlapping [m]."""
    forces_n: Float
    """(n,) normal force [N]."""
    others: NDArray[np.int64]
    """(n,) instance_id of what is touched; −1 is the support, below are unknown objects (``core/surroundings.py``)."""

    def split(self, ends: Sequence[int]) -> tuple[Contacts, ...]:
        """Split the contacts of all steps into those of each step; ``ends`` has the end index of each step."""
        parts = [slice(*part) for part in pairwise((0, *ends))]
        return tuple(
            Contacts(self.points_cam[k], self.normals_cam[k], self.depths_m[k], self.forces_n[k], self.others[k])
            for k in parts
        )


NO_CONTACTS = Contacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))


class Tipping(Struct, frozen=True):
    """Evidence that a simulated object does not stand: it touches something, but its centre of mass is unsupported."""

    overhang_m: Real
    """Distance of the centre of mass to what supports the object, seen along gravity [m]."""
    step: Number
    """The step, 1, 2, …, at whose end this holds: the last one, or, where it fell over until the end, the first with a
    contact."""


class SimulatedPath(Struct, frozen=True, eq=False):
    """Path of a simulated object, pose by pose."""

    Ts_cam_obj: Float
    """(S + 1, 4, 4) the start, then a pose for each of S steps [m]."""
    contacts: tuple[Contacts, ...]
    """Contacts at the end of each of the S steps."""
    tipping: Tipping | None = None
    """None: it stands, falls freely, or sinks in too deep to decide."""

    @property
    def T_cam_obj(self) -> Float:
        """The last pose (4, 4)."""
        return self.Ts_cam_obj[-1]


TIMES = ("ms", "score_ms", "spent_s", "ms_refine", "ms_simulate", "ms_score", "ms_total", "seconds", "stages_ms")
"""Fields that differ from run to run and are left out of comparisons."""

StageName = Literal["initial", "current", "simulated", "mixed", "refined", "flipped", "edited"]

MarkKind = Literal["flip", "jump", "lost", "recovered"]
"""What can stand out in an object's motion over the frames of a sequence (``evaluation/pose_motion.py``)."""

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


class Stage(Struct, frozen=True, eq=False):
    """One pose on the way through an iteration."""

    name: StageName
    T_cam_obj: Float
    score: PoseScore | None = None
    """None where the method does not score the pose (the mixed pose only starts the refiner)."""
    ms: Real = 0.0
    """Time it took to compute the pose [ms]."""

    def __repr__(self) -> str:
        return f"<Stage {self.name}{'' if self.score is None else f', score {self.score.score:.3f}'}>"

    def with_score(self, score: PoseScore | None) -> Stage:
        """Return the stage with its score."""
        return Stage(self.name, self.T_cam_obj, score, self.ms)


class Choice(Struct, frozen=True, eq=False):
    """The bandit's numbers as they were when it chose."""

    arm: Index
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


class Best(Struct, frozen=True, eq=False):
    """The answer for one object, so far."""

    T_cam_obj: Float
    score: PoseScore
    arm: Index
    iteration: Index
    """0 = an initial pose."""
    stage: StageName


class Event(Struct, frozen=True, eq=False):
    """Something about an iteration that gets a mark on the timeline."""

    kind: EventKind
    text: str
    """One sentence with numbers and units."""


class PlacedPose(Struct, frozen=True, eq=False):
    """An object that stood in the scene while another was worked on."""

    instance_id: Id
    T_cam_obj: Float


class SceneRecord(Struct, frozen=True, eq=False):
    """End of a pass over the objects of a cluster: how well their poses explain the scene together."""

    poses: tuple[PlacedPose, ...]
    """Poses of this pass, in dependency order."""
    score: PoseScore
    """Scene score of this pass."""
    best_known: PoseScore
    """Scene score of the best poses so far of all objects, together."""
    reward: Real
    """Reward of the arms that were chosen in this pass."""
    incumbent: tuple[PlacedPose, ...]
    """The combination with the highest scene score ever seen."""
    incumbent_score: Real


class TreeNode(Struct, frozen=True, eq=False):
    """One node of a search tree: an object placed from one of its hypotheses, after the objects of the nodes above."""

    node: Index
    """Number of the node in the order of creation; 0 is the root, in which nothing is placed."""
    parent: Index
    instance_id: Id
    arm: Index
    lcp: Real
    """Share of the model's points that the segment explains at the hypothesis, in [0, 1]; high ones are tried first."""
    T_cam_obj: Float
    """The pose after refinement and simulation."""


class TreeStep(Struct, frozen=True, eq=False):
    """Change of the search tree by one iteration; all changes so far add up to the tree."""

    cluster: Index
    """Each cluster has a tree of its own, with nodes numbered from 0."""
    branch: tuple[Index, ...]
    """Nodes from the root to the visited one, which is new unless the tree is complete there."""
    node: TreeNode | None
    """The added node; None where the branch was already expanded to its end."""
    choices: tuple[str, ...]
    """Why each node of the branch below the root was chosen, in words."""
    rollout: tuple[PlacedPose, ...]
    """The poses that completed the rest of the scene, object by object."""
    rollout_arms: tuple[Index, ...]
    cost_px: Real
    """Pixels of the complete scene that are not explained; added to every node of the branch, with one visit."""
    incumbent: tuple[PlacedPose, ...]
    """The complete scene with the lowest cost ever seen."""
    incumbent_cost_px: Real


class Iteration(Struct, frozen=True, eq=False):
    """One step of a method."""

    index: Number
    """Number of the iteration, 1, 2, … over the whole run."""
    instance_id: Id
    obj_id: Id
    arm: Index
    """Index of the hypothesis that was worked on."""
    arm_iteration: Number
    """Number of the iteration among those of this arm, 1, 2, …."""
    stages: tuple[Stage, ...]
    """Stages in the order in which they were computed; "current" first."""
    accepted: StageName
    """The stage that the next iteration of this arm starts from."""
    best: Best
    """Best pose of this object after this iteration."""
    path: SimulatedPath | None = None
    choice: Choice | None = None
    """None for methods that do not choose between hypotheses."""
    events: tuple[Event, ...] = ()
    placed: tuple[PlacedPose, ...] = ()
    """Other objects in the simulation, which may also hide parts in the score, in the order they were placed."""
    scene_pass: Number | None = None
    """Number of the pass over its cluster, 1, 2, …; vf_depth only."""
    scene: SceneRecord | None = None
    """End of a pass, at the iteration of its last object; vf_depth only."""
    tree: TreeStep | None = None
    """Change of the search tree; physim_mcts only."""
    score_ms: Real = 0.0
    """Time the iteration waited for its scores [ms]; scores computed while the refiner runs cost none."""

    def __repr__(self) -> str:
        score = self.accepted_stage.score
        scored = "" if score is None else f", score {score.score:.3f}"
        return f"<Iteration {self.index} of object {self.instance_id}, hypothesis {self.arm}: {self.accepted}{scored}>"

    def stage(self, name: StageName) -> Stage | None:
        """The stage of that name, or None."""
        for stage in self.stages:
            if stage.name == name:
                return stage
        return None

    @property
    def before_refined(self) -> Stage | None:
        """The pose that the refiner started from; None in an iteration without it."""
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
