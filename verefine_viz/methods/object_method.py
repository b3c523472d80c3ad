"""The loop that every method shares for one object: choose a hypothesis, move it on, score it, keep the best.

With the chain of SIR and the policy UCB it is RIR (paper Sec. III-C).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.clock import clock
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Best, Iteration, PlacedPose, Stage, StageName
from verefine_viz.core.scores import PoseScore, Scores
from verefine_viz.methods.arms import AcceptedPose, Arm, ObjectState, initial_arms
from verefine_viz.methods.bandit import Policy, next_choice
from verefine_viz.methods.events import events_of
from verefine_viz.methods.single_object import BeginScore, Chain, Draft

FAR_RAD, LEAST_GAIN = np.radians(20.0), 0.1
"""A flip by a larger turn wins only if its score is higher by the worth of this much more colour correlation: where the
observed side has no print, the correlations of the two sides differ by some hundredths either way."""
Flips = Callable[[ObjectModel], Float]
"""Turns (N, 4, 4) of a model's frame after which its shape looks nearly the same."""


@dataclass(frozen=True)
class ObjectMethod:
    """A chain for each hypothesis and, with several hypotheses, a policy that chooses among them."""

    chain: Chain
    verifier: Verifier
    iterations: int
    """K, per hypothesis."""
    policy: Policy | None = None
    """None: only the first hypothesis is used."""
    answer_is_best_scored: bool = True
    """False: the answer is the last pose, and scores are only shown."""
    never_worse: bool = False
    """Whether the current pose stays when every candidate scores lower than it."""
    placed_may_hide: bool = True
    """Whether objects placed before are rendered as what may hide the one being scored (docs/methods.md 1.8.2)."""
    flips: Flips | None = None
    """Flips of a model, which compete with a promising pose; None = none (docs/methods.md 1.11)."""

    def start(self, target: Target, fixed: Sequence[Placed] = ()) -> ObjectState | None:
        """The state before the first iteration; None where the pool is empty."""
        hypotheses = target.instance.hypotheses
        if not hypotheses:
            return None
        # Sec. III-C: RIR starts by ranking the initial estimates by their score, the first play of each arm.
        initial = self._score(target, np.array([h.T_cam_obj for h in hypotheses]), fixed)
        arms = initial_arms(hypotheses, initial)
        if self.policy is None:
            arms = arms[:1]
        return ObjectState(target, initial, arms, self._first_answer(arms))

    def n_iterations(self, state: ObjectState) -> int:
        return self.iterations * len(state.arms)

    def is_done(self, state: ObjectState) -> bool:
        return state.n_done >= self.n_iterations(state)

    def step(self, state: ObjectState, index: int, fixed: Sequence[Placed] = ()) -> tuple[ObjectState, Iteration]:
        """One iteration of the chosen hypothesis, which is rewarded with its better candidate's score.

        Args:
            state: before it.
            index: counts over the whole run.
            fixed: objects already placed.
        """
        after, iteration, reward = self.advance(state, index, fixed)
        # Sec. III-C: the verification score is the reward.
        return after.rewarded(iteration.arm, reward), iteration

    def advance(
        self, state: ObjectState, index: int, fixed: Sequence[Placed] = ()
    ) -> tuple[ObjectState, Iteration, float]:
        """One iteration like :meth:`step`, except that the caller gives the reward, the third value."""
        # Sec. III-C: the arm with the largest UCB is pulled, which means one SIR iteration of its latest pose.
        choice = next_choice(self.policy, state) if self.policy else None
        j = choice.arm if choice else 0
        arm = state.arms[j]
        k = arm.n_iterations + 1
        # Sec. III-A: T_cur → T_sim → [R_sim | t_cur] → T_ref.
        scoring = _IterationScores(self.verifier, state.target, self._may_hide(fixed))
        draft = self._draft(state, j, fixed, scoring.begin)
        # Sec. III-B: both are scored (Eq. 1), and the iteration proceeds with the better one.
        started = clock()
        stages = scoring.scored(draft)
        current = Stage("current", arm.current.T_cam_obj, arm.current.score)
        candidates = [s for s in stages if s.name in draft.candidates]
        accepted = self._accepted(current, candidates)
        flipped = self._flipped(state, accepted, k, fixed)
        if flipped is not None:
            accepted, stages, candidates = flipped, (*stages, flipped), [*candidates, flipped]
        score_ms = (clock() - started) * 1e3
        entry = AcceptedPose(accepted.T_cam_obj, _score_of(accepted), accepted.name, index)
        reward = max(_score_of(s).score for s in candidates)
        # Sec. III-B, III-C: the answer is the best of all poses on the way, the initial ones included.
        best = self._better(state.best, entry, j)
        iteration = Iteration(
            index,
            state.target.instance.instance_id,
            state.target.model.obj_id,
            j,
            k,
            (current, *stages),
            accepted.name,
            best,
            draft.path,
            choice,
            placed=tuple(PlacedPose(p.instance_id, p.T_cam_obj) for p in fixed),
            score_ms=score_ms,
        )
        iteration = structs.replace(iteration, events=events_of(iteration, draft, state))
        return state.with_arm(j, arm.advanced(entry), best), iteration, reward

    def _draft(self, state: ObjectState, j: int, fixed: Sequence[Placed], begin: BeginScore) -> Draft:
        """The poses of the next iteration of hypothesis ``j``."""
        arm = state.arms[j]
        return self.chain.draft(state.target, arm.current.T_cam_obj, arm.n_iterations + 1, fixed, begin)

    def rescored(self, state: ObjectState, fixed: Sequence[Placed] = ()) -> ObjectState:
        """The state with all its poses scored again by this method, among ``fixed`` objects.

        The mean of a hypothesis becomes that over its initial pose, or the edited one in its place, and the poses
        accepted since.
        """
        hypotheses = state.target.instance.hypotheses
        initial = self._score(state.target, np.array([h.T_cam_obj for h in hypotheses]), fixed)
        arms: list[Arm] = []
        for arm in state.arms:
            scores = self._score(state.target, np.array([e.T_cam_obj for e in arm.entries]), fixed)
            entries = tuple(replace(e, score=scores[k]) for k, e in enumerate(arm.entries))
            scored = replace(arm, entries=entries)
            mean = float(np.mean([e.score.score for e in scored.entries_since_edit]))
            arms.append(replace(scored, mean=mean))
        best = self._first_answer(arms)
        for j, arm in enumerate(arms):
            for entry in arm.entries[1:]:
                best = self._better(best, entry, j)
        return replace(state, initial=initial, arms=tuple(arms), best=best)

    def edit(
        self, state: ObjectState, arm: int, T_cam_obj: Float, index: int, fixed: Sequence[Placed] = ()
    ) -> ObjectState:
        """The state with the current pose of ``arm`` replaced, scored, and counted for the answer.

        It is the next to be played, unless the object has used its budget.
        """
        score = self._score(state.target, np.asarray(T_cam_obj, dtype=np.float64)[None], fixed)[0]
        edited = state.with_edited(arm, T_cam_obj, score, index)
        waiting = () if self.is_done(state) else edited.edited_arms
        return replace(edited, best=self._better(state.best, edited.arms[arm].current, arm), edited_arms=waiting)

    def _score(self, target: Target, Ts_cam_obj: Float, fixed: Sequence[Placed]) -> Scores:
        return self.verifier.score(target, Ts_cam_obj, self._may_hide(fixed))

    def _may_hide(self, fixed: Sequence[Placed]) -> Sequence[Placed]:
        return fixed if self.placed_may_hide else ()

    def _first_answer(self, arms: Sequence[Arm]) -> Best:
        """The answer before the first iteration."""
        j = int(np.argmax([arm.entries[0].score.score for arm in arms])) if self.answer_is_best_scored else 0
        return arms[j].entries[0].as_best(j)

    def _flipped(self, state: ObjectState, accepted: Stage, k: int, fixed: Sequence[Placed]) -> Stage | None:
        """The flip that wins over a promising pose: over a hypothesis' first one, and over any that is the best so far.
        None where none does, and where depth alone would choose (docs/methods.md 1.11).
        """
        score = _score_of(accepted)
        is_promising = k == 1 or score.score > state.best.score.score
        if self.flips is None or not (is_promising and score.colour_weight > 0):
            return None
        turns = self.flips(state.target.model)
        if len(turns) == 0:
            return None
        Ts_cam_obj = accepted.T_cam_obj @ turns
        scores = self._score(state.target, Ts_cam_obj, fixed)
        is_far = np.trace(turns[:, :3, :3], axis1=1, axis2=2) < 1 + 2 * np.cos(FAR_RAD)
        gains = scores.score - score.score - is_far * LEAST_GAIN * score.colour_weight
        j = int(np.argmax(gains))
        return Stage("flipped", as_rigid(Ts_cam_obj[j], "flipped pose"), scores[j]) if gains[j] > 0 else None

    def _accepted(self, current: Stage, candidates: list[Stage]) -> Stage:
        """The candidate with the highest score; the later of the two on ties (docs/methods.md 1.3)."""
        better = max(reversed(candidates), key=lambda s: _score_of(s).score)
        if self.never_worse and _score_of(better).score < _score_of(current).score:
            return current
        return better

    def _better(self, best: Best, entry: AcceptedPose, arm: int) -> Best:
        if self.answer_is_best_scored and not entry.score.score > best.score.score:
            return best
        return entry.as_best(arm)


@dataclass(frozen=True, eq=False)
class _IterationScores:
    """Scores the poses of one iteration, some of them while the next are computed."""

    verifier: Verifier
    target: Target
    placed: Sequence[Placed]
    """Other objects, which may hide parts."""
    _begun: dict[StageName, Callable[[], Scores]] = field(default_factory=dict)

    def begin(self, stage: Stage) -> None:
        """Has a pose scored while the next one is computed, where the verifier can do that."""
        scores = self.verifier.begin(self.target, stage.T_cam_obj[None], self.placed)
        if scores is not None:
            self._begun[stage.name] = scores

    def scored(self, draft: Draft) -> tuple[Stage, ...]:
        """The stages with their scores: those begun before, and one call for all others.

        The mixed pose is scored only where it may be accepted, since it only starts the refiner.
        """
        not_scored = () if "mixed" in draft.candidates else ("mixed",)
        others = [s for s in draft.stages if s.name not in (*self._begun, *not_scored)]
        scores = self.verifier.score(self.target, np.array([s.T_cam_obj for s in others]), self.placed)
        of_stage = {s.name: scores[i] for i, s in enumerate(others)}
        of_stage |= {name: begun()[0] for name, begun in self._begun.items()}
        return tuple(s.with_score(of_stage.get(s.name)) for s in draft.stages)


def _score_of(stage: Stage) -> PoseScore:
    assert stage.score is not None, f"the {stage.name} stage was not scored"
    return stage.score
