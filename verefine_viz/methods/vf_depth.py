"""VF_d, VeREFINE depth (paper Sec. IV-C): a whole scene is refined pass by pass.

In each pass every object of a cluster, in dependency order, spends one iteration on one of its hypotheses, among what
the pass has placed so far. The poses of the pass are then rendered together, and their score as a scene rewards the
hypotheses that were chosen; rewards of earlier passes count a little less each time, because the other objects of the
cluster have moved since.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.clock import clock
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.core.records import Best, Event, Iteration, PlacedPose, SceneRecord
from verefine_viz.core.scores import Scores
from verefine_viz.methods.arms import ObjectState
from verefine_viz.methods.events import SCORE_STEP
from verefine_viz.methods.per_object import FrameState, PerObject, clusters_of

Combination = tuple[Best, ...]
"""A pose of each member of a cluster."""


@dataclass(frozen=True, eq=False)
class SceneState:
    """State of VF_d in a cluster of several objects."""

    members: tuple[int, ...]
    """Indices of its instances that have a hypothesis, in dependency order."""
    incumbent: Combination
    """Per member: the combination with the highest scene score ever seen."""
    incumbent_score: float
    n_passes: int = 0
    """Completed passes."""
    passing: Combination = ()
    """Poses in the current pass, of the members that had their turn."""
    played: tuple[int | None, ...] = ()
    """Arms in the current pass; None where a member has used its budget and stays at its best pose."""


@dataclass(frozen=True, eq=False)
class DepthState(FrameState):
    """State of VF_d in a frame."""

    scenes: tuple[SceneState | None, ...] = ()
    """Per cluster; None where it has fewer than two objects to solve."""
    answer_is_incumbent: bool = True

    @property
    def best(self) -> tuple[Best | None, ...]:
        answers = list(super().best)
        if self.answer_is_incumbent:
            for scene in filter(None, self.scenes):
                for i, best in zip(scene.members, scene.incumbent, strict=True):
                    answers[i] = best
        return tuple(answers)

    def member(self, i: int) -> ObjectState:
        """The i-th instance, a member of a scene: it has a hypothesis."""
        o = self.objects[i]
        assert o is not None
        return o

    def with_scene(self, k: int, scene: SceneState) -> DepthState:
        """The state with the k-th cluster's scene replaced."""
        return replace(self, scenes=(*self.scenes[:k], scene, *self.scenes[k + 1 :]))

    def placed_at(self, members: Sequence[int], poses: Sequence[Best]) -> tuple[Placed, ...]:
        """The first members, as many as there are poses, placed at these poses."""
        targets = [self.problem.targets[i] for i in members[: len(poses)]]
        return tuple(
            Placed(t.instance.instance_id, t.model, best.T_cam_obj) for t, best in zip(targets, poses, strict=True)
        )


@dataclass(frozen=True)
class VfDepth(PerObject):
    """Passes over the objects of a cluster, rewarded by the scene score; a cluster of one object is solved by RIR."""

    discount: float = 0.99
    """γ."""
    reward: Literal["current_pass", "best_known"] = "current_pass"
    """Whose scene score rewards a pass (docs/methods.md 1.8.11)."""
    answer: Literal["incumbent", "per_object"] = "incumbent"
    """What the result is (docs/methods.md 1.8.12)."""
    prior: Literal["scene", "object"] = "scene"
    """What an arm's first play is worth (docs/methods.md 1.8.13)."""
    whole_frame: bool = False
    """Whether the scene score of ``published`` pixels counts all objects of the frame (docs/methods.md 1.8.15)."""
    carry_clusters: bool = True
    """Whether earlier clusters stay in the scene of later ones (docs/methods.md 1.8.16)."""

    def start(self, problem: Problem) -> DepthState:
        return self._adopted(super().start(problem))

    def step(self, state: FrameState) -> tuple[FrameState, Iteration]:
        state = self._adopted(state)
        k = self._cluster(state)
        if k is None:
            raise InputError("the run is over: every object has used its budget")
        # The current cluster, among the objects that earlier clusters placed. Sec. IV-C: its RIR bandits are
        # initialized using the verification score, before the first iteration through its dependency list.
        carried = self._carried(state, k)
        if carried and self._is_untouched(state, k):
            state = self._opened(state, k, carried)
        scene = state.scenes[k]
        # A single object: RIR. Otherwise the next object of the dependency list.
        if scene is None:
            return super().step(state)
        return self._step_of_pass(state, k, scene, carried)

    def _step_of_pass(
        self, state: DepthState, k: int, scene: SceneState, carried: tuple[Placed, ...]
    ) -> tuple[DepthState, Iteration]:
        """One object's turn in a pass; the last one's closes the pass."""
        # Sec. IV-C: iterate through the dependency list; this is the next object.
        scene = self._without_spent(state, scene)
        i = scene.members[len(scene.passing)]
        # Sec. IV-C: its RIR bandit is progressed only once, among the poses that this pass has placed. No reward yet.
        fixed = (*carried, *state.placed_at(scene.members, scene.passing))
        after, iteration, _ = self.method.advance(state.member(i), state.n_done + 1, fixed)
        # Its accepted pose stands in the environment of the objects after it.
        accepted = after.arms[iteration.arm].current.as_best(iteration.arm)
        scene = replace(scene, passing=(*scene.passing, accepted), played=(*scene.played, iteration.arm))
        state = state.with_object(i, after, state.n_done + 1)
        iteration = structs.replace(iteration, scene_pass=scene.n_passes + 1)
        # Sec. IV-C: after the last object the pass is evaluated as a complete scene.
        scene = self._without_spent(state, scene)
        if len(scene.passing) == len(scene.members):
            state, scene, iteration = self._closed(state, scene, carried, iteration)
        state = state.with_scene(k, scene)
        best = state.best[i]
        assert best is not None
        return state, structs.replace(iteration, best=best)

    def _without_spent(self, state: DepthState, scene: SceneState) -> SceneState:
        """Members next in turn whose budget is used stand at their best pose."""
        passing, played = list(scene.passing), list(scene.played)
        for i in scene.members[len(passing) :]:
            if not self.method.is_done(state.member(i)):
                break
            passing.append(state.member(i).best)
            played.append(None)
        return replace(scene, passing=tuple(passing), played=tuple(played))

    def _closed(
        self, state: DepthState, scene: SceneState, carried: tuple[Placed, ...], iteration: Iteration
    ) -> tuple[DepthState, SceneState, Iteration]:
        """The end of a pass: its poses as a scene, the rewards, and the best scene so far."""
        # Sec. IV-C: the poses of the pass, and the best known ones, each as a complete scene (docs/methods.md 1.8.11).
        started = clock()
        best_known = tuple(state.member(i).best for i in scene.members)
        scores = self._scene_scores(state, scene.members, [scene.passing, best_known], carried)
        reward = float(scores.score[0 if self.reward == "current_pass" else 1])
        # Sec. IV-C: the scene fit is the reward of the selected hypotheses instead of the per-object reward. D-UCB
        # replaces UCB: the reward and plays statistics are discounted by γ each pass.
        for i, arm in zip(scene.members, scene.played, strict=True):
            if arm is not None:
                state = state.with_object(i, state.member(i).rewarded(arm, reward, self.discount))
        # The answer is the best scene ever seen (docs/methods.md 1.8.12).
        incumbent, highest = scene.incumbent, scene.incumbent_score
        for combination, score in zip((scene.passing, best_known), scores.score.tolist(), strict=True):
            if score > highest:
                incumbent, highest = combination, score
        events = iteration.events
        if highest >= scene.incumbent_score + SCORE_STEP:
            text = f"New best scene: {highest:.3f}, was {scene.incumbent_score:.3f}."
            events = (*events, Event("new_best_scene", text))

        def poses(combination: Combination) -> tuple[PlacedPose, ...]:
            return tuple(PlacedPose(p.instance_id, p.T_cam_obj) for p in state.placed_at(scene.members, combination))

        record = SceneRecord(poses(scene.passing), scores[0], scores[1], reward, poses(incumbent), highest)
        score_ms = iteration.score_ms + (clock() - started) * 1e3
        iteration = structs.replace(iteration, scene=record, events=events, score_ms=score_ms)
        return state, SceneState(scene.members, incumbent, highest, scene.n_passes + 1), iteration

    def _opened(self, state: DepthState, k: int, carried: tuple[Placed, ...]) -> DepthState:
        """The k-th cluster before its first iteration: initial poses scored, alone and as a scene."""
        members = tuple(i for i in clusters_of(state.problem)[k] if state.objects[i])
        if len(members) < 2:
            return state
        if carried:
            for i in members:
                state = state.with_object(i, self.method.rescored(state.member(i), carried))
        # Sec. IV-C: the bandits begin with the verification score; of which scene: docs/methods.md 1.8.13.
        first = tuple(state.member(i).best for i in members)
        combinations = [first]
        takes_prior = self.prior == "scene" and self._is_untouched(state, k)
        if takes_prior:
            for slot, i in enumerate(members):
                for j, arm in enumerate(state.member(i).arms):
                    combinations.append(_with_pose(first, slot, arm.current.as_best(j)))
        scores = self._scene_scores(state, members, combinations, carried).score.tolist()
        if takes_prior:
            rest = iter(scores[1:])
            for i in members:
                arms = tuple(replace(arm, mean=next(rest)) for arm in state.member(i).arms)
                state = state.with_object(i, replace(state.member(i), arms=arms))
        return state.with_scene(k, SceneState(members, first, scores[0]))

    def edit(self, state: FrameState, instance_id: int, arm: int, T_cam_obj: Float) -> FrameState:
        edited = self._adopted(super().edit(state, instance_id, arm, T_cam_obj))
        i, o = edited.object_to_edit(instance_id)
        for k, scene in enumerate(edited.scenes):
            if scene is None or i not in scene.members:
                continue
            # The edited pose also counts together with the other poses of the best scene.
            combination = _with_pose(scene.incumbent, scene.members.index(i), o.arms[arm].current.as_best(arm))
            score = float(self._scene_scores(edited, scene.members, [combination], self._carried(edited, k)).score[0])
            if self.prior == "scene":  # As for every first play: on the scale of the rewards.
                arms = (*o.arms[:arm], replace(o.arms[arm], mean=score), *o.arms[arm + 1 :])
                edited = edited.with_object(i, replace(o, arms=arms))
            if score > scene.incumbent_score:
                scene = replace(scene, incumbent=combination, incumbent_score=score)
            return edited.with_scene(k, scene)
        return edited

    def rescored(self, state: FrameState) -> FrameState:
        """
        Raises:
            InputError: passes were already scored, and their poses are no longer known.
        """
        if isinstance(state, DepthState) and any(state.scenes):
            raise InputError(
                "the score cannot change on the way of vf_depth, whose rewards are scores of whole scenes; "
                "begin again with these settings"
            )
        return PerObject(self.method).rescored(FrameState(state.problem, state.objects, state.n_done))

    def _adopted(self, state: FrameState) -> DepthState:
        if isinstance(state, DepthState):
            return state
        n_clusters = len(clusters_of(state.problem))
        adopted = DepthState(
            state.problem, state.objects, state.n_done, (None,) * n_clusters, self.answer == "incumbent"
        )
        for k in range(n_clusters):
            adopted = self._opened(adopted, k, ())
        return adopted

    def _scene_scores(
        self,
        state: DepthState,
        members: Sequence[int],
        combinations: Sequence[Combination],
        carried: tuple[Placed, ...],
    ) -> Scores:
        """Scores of combinations of poses of a cluster's members, each as a complete scene."""
        targets = [state.problem.targets[i] for i in members]
        Ts = np.array([[best.T_cam_obj for best in combination] for combination in combinations])
        placed = carried if self.method.placed_may_hide else ()
        return self.method.verifier.score_scene(targets, Ts, placed, self.whole_frame)

    def _fixed(self, state: FrameState, i: int) -> tuple[Placed, ...]:
        assert isinstance(state, DepthState)
        k = next(k for k, cluster in enumerate(clusters_of(state.problem)) if i in cluster)
        scene, carried = state.scenes[k], self._carried(state, k)
        if scene is None:
            return carried
        before = scene.members.index(i) if i in scene.members else 0
        return (*carried, *state.placed_at(scene.members, scene.passing[:before]))

    def _order(self, problem: Problem) -> Sequence[int]:
        return [i for cluster in clusters_of(problem) for i in cluster]

    def _next(self, state: FrameState) -> int | None:
        """The first in turn, also where a pose was edited: a pass needs its order."""
        return next(iter(self._turns(state)), None)

    def _cluster(self, state: DepthState) -> int | None:
        """The first cluster with an object whose budget is not used."""
        for k, cluster in enumerate(clusters_of(state.problem)):
            if any(o and not self.method.is_done(o) for o in (state.objects[i] for i in cluster)):
                return k
        return None

    def _is_untouched(self, state: DepthState, k: int) -> bool:
        return all(o is None or o.n_done == 0 for o in (state.objects[i] for i in clusters_of(state.problem)[k]))

    def _carried(self, state: DepthState, k: int) -> tuple[Placed, ...]:
        """Objects that earlier clusters placed in the scene."""
        if not self.carry_clusters:
            return ()
        before = [i for cluster in clusters_of(state.problem)[:k] for i in cluster]
        return tuple(state.placed(i) for i in before if state.objects[i])


def _with_pose(combination: Combination, slot: int, best: Best) -> Combination:
    """The combination with another pose for one member."""
    return (*combination[:slot], best, *combination[slot + 1 :])
