"""The loop that every method shares for one object: choose a hypothesis, move it on, judge it, keep the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Best, Iteration, PlacedPose, Stage
from verefine_viz.core.scores import PoseScore, Scores
from verefine_viz.methods.arms import Arm, Entry, ObjectState
from verefine_viz.methods.bandit import Policy, next_choice
from verefine_viz.methods.events import events_of
from verefine_viz.methods.iteration_step import Chain, Judging


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
    """Else the answer is the last pose, and scores are only shown."""
    never_worse: bool = False
    """Whether the current pose is kept when every candidate scores lower than it."""
    placed_may_hide: bool = True
    """Whether objects placed before are rendered as what may hide the one being judged (docs/methods.md 1.8.2)."""

    def start(self, target: Target, fixed: Sequence[Placed] = ()) -> ObjectState | None:
        """The state before the first iteration; None where the pool is empty."""
        hypotheses = target.instance.hypotheses
        if not hypotheses:
            return None
        initial = self._score(target, np.array([h.T_cam_obj for h in hypotheses]), fixed)
        entries = [Entry(h.T_cam_obj, initial[j], "initial", 0) for j, h in enumerate(hypotheses)]
        # Sec. III-C: the initial poses are ranked by their score, which counts as the first play of each arm.
        arms = tuple(Arm((entry,), 1.0, entry.score.score) for entry in entries)
        if self.policy is None:
            arms = arms[:1]
        first = self._first(arms)
        return ObjectState(target, initial, arms, _best(entries[first], first))

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
        moved, iteration, reward = self.advance(state, index, fixed)
        return moved.rewarded(iteration.arm, reward), iteration

    def advance(
        self, state: ObjectState, index: int, fixed: Sequence[Placed] = ()
    ) -> tuple[ObjectState, Iteration, float]:
        """One iteration like :meth:`step` whose reward, the third value, is left to the caller to give."""
        # Sec. III-C: the arm with the largest UCB is pulled, which means one SIR iteration of its latest pose.
        choice = next_choice(self.policy, state) if self.policy else None
        j = choice.arm if choice else 0
        arm = state.arms[j]
        k = arm.n_iterations + 1
        judging = Judging(self.verifier, state.target, self._may_hide(fixed))
        draft = self.chain.draft(state.target, arm.current.T_cam_obj, k, fixed, judging.begin)
        began = perf_counter()
        stages = judging.judged(draft)
        score_ms = (perf_counter() - began) * 1e3
        current = Stage("current", arm.current.T_cam_obj, arm.current.score)
        candidates = [s for s in stages if s.name in draft.candidates]
        # Sec. III-B: go on with the better of T_sim and T_ref.
        kept = self._keep(current, candidates)
        entry = Entry(kept.T_cam_obj, _known(kept), kept.name, index)
        reward = max(_known(s).score for s in candidates)
        # The answer is the best of all poses on the way, the initial ones included.
        best = self._better(state.best, entry, j)
        iteration = Iteration(
            index,
            state.target.instance.instance_id,
            state.target.model.obj_id,
            j,
            k,
            (current, *stages),
            kept.name,
            best,
            draft.path,
            choice,
            placed=tuple(PlacedPose(p.instance_id, p.T_cam_obj) for p in fixed),
            score_ms=score_ms,
        )
        iteration = replace(iteration, events=events_of(iteration, draft, state))
        return state.with_arm(j, arm.moved(entry), best), iteration, reward

    def judged_anew(self, state: ObjectState, fixed: Sequence[Placed] = ()) -> ObjectState:
        """The same with all its poses judged by this method, among ``fixed`` objects.

        The mean of a hypothesis becomes that of its initial pose, or the one that a person put in its place, and of
        those that its iterations kept since.
        """
        hypotheses = state.target.instance.hypotheses
        initial = self._score(state.target, np.array([h.T_cam_obj for h in hypotheses]), fixed)
        arms: list[Arm] = []
        for arm in state.arms:
            scores = self._score(state.target, np.array([e.T_cam_obj for e in arm.entries]), fixed)
            entries = tuple(replace(e, score=scores[k]) for k, e in enumerate(arm.entries))
            judged = replace(arm, entries=entries)
            mean = float(np.mean([e.score.score for e in judged.own_entries]))
            arms.append(replace(judged, mean=mean))
        first = self._first(arms)
        best = _best(arms[first].entries[0], first)
        for j, arm in enumerate(arms):
            for entry in arm.entries[1:]:
                best = self._better(best, entry, j)
        return replace(state, initial=initial, arms=tuple(arms), best=best)

    def edit(
        self, state: ObjectState, arm: int, T_cam_obj: Float, index: int, fixed: Sequence[Placed] = ()
    ) -> ObjectState:
        """The same state with the current pose of ``arm`` replaced, scored, and counted for the answer.

        It is the next to be played, unless the object has used its budget.
        """
        score = self._score(state.target, np.asarray(T_cam_obj, dtype=np.float64)[None], fixed)[0]
        edited = state.with_edited(arm, T_cam_obj, score, index)
        waiting = () if self.is_done(state) else edited.by_hand
        return replace(edited, best=self._better(state.best, edited.arms[arm].current, arm), by_hand=waiting)

    def _score(self, target: Target, Ts_cam_obj: Float, fixed: Sequence[Placed]) -> Scores:
        return self.verifier.score(target, Ts_cam_obj, self._may_hide(fixed))

    def _may_hide(self, fixed: Sequence[Placed]) -> Sequence[Placed]:
        return fixed if self.placed_may_hide else ()

    def _first(self, arms: Sequence[Arm]) -> int:
        """The arm whose initial pose is the answer before the first iteration."""
        return int(np.argmax([arm.entries[0].score.score for arm in arms])) if self.answer_is_best_scored else 0

    def _keep(self, current: Stage, candidates: list[Stage]) -> Stage:
        """The candidate with the highest score; the later of the two on ties (docs/methods.md 1.3)."""
        kept = max(reversed(candidates), key=lambda s: _known(s).score)
        if self.never_worse and _known(kept).score < _known(current).score:
            return current
        return kept

    def _better(self, best: Best, entry: Entry, arm: int) -> Best:
        if self.answer_is_best_scored and not entry.score.score > best.score.score:
            return best
        return _best(entry, arm)


def _best(entry: Entry, arm: int) -> Best:
    return Best(entry.T_cam_obj, entry.score, arm, entry.iteration, entry.stage)


def _known(stage: Stage) -> PoseScore:
    assert stage.score is not None, f"the {stage.name} stage was not judged"
    return stage.score
