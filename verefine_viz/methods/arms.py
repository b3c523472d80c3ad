"""The state of one object: its hypotheses as the arms of a bandit, each with the poses it went through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.core.records import Best, StageName
from verefine_viz.core.scores import PoseScore, Scores


@dataclass(frozen=True, eq=False)
class AcceptedPose:
    """One pose that was accepted."""

    T_cam_obj: Float
    score: PoseScore
    stage: StageName
    iteration: int
    """Iteration of the whole run; 0 = initial."""

    def as_best(self, arm: int) -> Best:
        """This pose of ``arm`` as an answer."""
        return Best(self.T_cam_obj, self.score, arm, self.iteration, self.stage)


@dataclass(frozen=True, eq=False)
class Arm:
    """One hypothesis on its way."""

    entries: tuple[AcceptedPose, ...]
    """Oldest first; entry 0 is the initial pose."""
    plays: float
    """n_j: the initial scoring counts as the first play."""
    mean: float
    """μ_j, mean reward over the plays."""
    n_iterations: int = 0
    """Iterations spent on it."""

    @property
    def current(self) -> AcceptedPose:
        return self.entries[-1]

    @property
    def entries_since_edit(self) -> tuple[AcceptedPose, ...]:
        """Entries that its plays and its mean count: from the initial pose on, or from the last edited one."""
        edited = max((k for k, entry in enumerate(self.entries) if entry.stage == "edited"), default=0)
        return self.entries[edited:]

    def advanced(self, entry: AcceptedPose) -> Arm:
        """The arm after one more iteration, which accepted ``entry``; its reward is still to come."""
        return Arm((*self.entries, entry), self.plays, self.mean, self.n_iterations + 1)

    def rewarded(self, reward: float) -> Arm:
        """The arm after one more play: μ ← (μ n + s)/(n + 1), n ← n + 1 (docs/methods.md 1.4)."""
        mean = (self.mean * self.plays + reward) / (self.plays + 1)
        return Arm(self.entries, self.plays + 1, mean, self.n_iterations)

    def discounted(self, discount: float) -> Arm:
        """The arm after a pass, with earlier plays counting less: the mean stays, n ← γ n (docs/methods.md 1.6)."""
        return Arm(self.entries, self.plays * discount, self.mean, self.n_iterations)


def initial_arms(hypotheses: Sequence[Hypothesis], scores: Scores) -> tuple[Arm, ...]:
    """An arm per hypothesis, whose score is its first play (paper Sec. III-C)."""
    entries = [AcceptedPose(h.T_cam_obj, scores[j], "initial", 0) for j, h in enumerate(hypotheses)]
    return tuple(Arm((entry,), 1.0, entry.score.score) for entry in entries)


@dataclass(frozen=True, eq=False)
class ObjectState:
    """State of a method for one object."""

    target: Target
    initial: Scores
    arms: tuple[Arm, ...]
    best: Best
    n_done: int = 0
    """Iterations spent on this object."""
    last_arm: int | None = None
    edited_arms: tuple[int, ...] = ()
    """Arms whose pose was edited and that were not played since, the latest first: played before all others."""
    was_ahead: bool = False
    """Whether its latest iteration was taken out of turn, for an edited arm."""

    @property
    def plays(self) -> list[float]:
        """Plays of each arm."""
        return [arm.plays for arm in self.arms]

    @property
    def means(self) -> list[float]:
        """Mean of each arm."""
        return [arm.mean for arm in self.arms]

    def with_arm(self, j: int, arm: Arm, best: Best) -> ObjectState:
        """One iteration further, spent on arm ``j``."""
        arms = (*self.arms[:j], arm, *self.arms[j + 1 :])
        edited = tuple(k for k in self.edited_arms if k != j)
        return ObjectState(self.target, self.initial, arms, best, self.n_done + 1, j, edited)

    def rewarded(self, j: int, reward: float, discount: float = 1.0) -> ObjectState:
        """The state after arm ``j`` was played for ``reward``; earlier plays count ``discount`` times as much."""
        arms = [arm.discounted(discount) for arm in self.arms] if discount != 1.0 else list(self.arms)
        arms[j] = arms[j].rewarded(reward)
        return replace(self, arms=tuple(arms))

    def with_edited(self, j: int, T_cam_obj: Float, score: PoseScore, iteration: int) -> ObjectState:
        """The state with the arm's current pose replaced by an edited one, from which it starts again and is played
        next.

        Raises:
            ShapeError: there is no such arm, or the pose is not rigid.
        """
        if not 0 <= j < len(self.arms):
            raise ShapeError(f"there is no hypothesis {j + 1}; this object has {len(self.arms)}")
        entry = AcceptedPose(as_rigid(T_cam_obj, "edited pose"), score, "edited", iteration)
        # The arm's earlier rewards say nothing about a pose that did not come from it: this is a new hypothesis in its
        # place, and begins as every hypothesis does, with its score as the first play (docs/methods.md 1.4).
        arm = Arm((*self.arms[j].entries, entry), 1.0, score.score, self.arms[j].n_iterations)
        edited = (j, *(k for k in self.edited_arms if k != j))
        return replace(self, arms=(*self.arms[:j], arm, *self.arms[j + 1 :]), edited_arms=edited)
