"""PHYSIM-MCTS, the system that the paper compares with (Mitash et al., ICRA 2018). docs/methods.md 3.3.

The objects of a cluster are placed one after another, each from one of its hypotheses, by trimmed ICP and physics;
Monte Carlo tree search decides which combination to try. One iteration selects a node, expands it by one object,
completes the scene with the most promising hypotheses of the other objects (the roll-out), and adds the number of
pixels that this scene leaves unexplained to the costs of the branch.

Mistakes of the published code that are corrected: the overlap that orders the children is that of the object placed
there, not of the one above; overlaps of zero and ties are allowed, and the first wins; overlaps are counted in full
(its library stops counting once a pose can no longer beat the best so far, so all other poses get too low an overlap);
and branches below which nothing is left to try are passed over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs
from scipy.spatial import KDTree

from verefine_viz.core.algorithm_settings import MctsSettings, TricpSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.clock import clock
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply
from verefine_viz.core.problem import Hypothesis, Problem, Target
from verefine_viz.core.protocols import Refiner, SceneRenderer, Simulator, Verifier
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.methods.arms import AcceptedPose, ObjectState, initial_arms
from verefine_viz.methods.per_object import FrameState, clusters_of
from verefine_viz.methods.scene_search import SceneSearch, Search
from verefine_viz.methods.search_tree import Candidate, SearchTree

DELTA_M = 0.005
"""A model point nearer than this to a point of the segment is explained [m]."""


REFINED_BEST = "largest overlap, aligned"
"""Source of the hypothesis that the search adds to each pool (docs/methods.md 3.2: the 26th of 25)."""

PUBLISHED_PHYSICS = {
    "steps": 60,
    "mass_kg": 10.0,
    "gravity_m_s2": 2.0,
    "damping": 0.99,
    "friction": 1.0,
    "collider": "hull",
    "margin_m": 1e-3,
    "placed": "static",
}
"""The simulator of the published system, as fields of ``PhysicsSettings``."""


def mcts_physics(settings: MctsSettings, session: PhysicsSettings) -> PhysicsSettings:
    """The simulator that the search uses, given the session's own."""
    return structs.replace(session, **PUBLISHED_PHYSICS) if settings.physics == "published" else session


def mcts_tricp(settings: MctsSettings, session: TricpSettings) -> TricpSettings:
    """The trimmed ICP that the search uses, given the session's own."""
    return structs.replace(session, trim=settings.trim)


def overlaps(target: Target, Ts_cam_obj: Float) -> Float:
    """LCP of poses (N, 4, 4) (docs/methods.md 3.2): share (N,) of the model's points within ``DELTA_M`` of the segment.

    In [0, 1]; for an object seen from one side, even the ground truth stays well below 1.
    """
    points, segment = target.model.points, target.instance.points_cam
    if len(points) == 0 or len(segment) == 0:
        return np.zeros(len(Ts_cam_obj))
    tree = KDTree(segment)
    moved = np.concatenate([apply(T, points) for T in Ts_cam_obj])
    distance_m = tree.query(moved, distance_upper_bound=DELTA_M)[0]
    return np.isfinite(distance_m).reshape(len(Ts_cam_obj), len(points)).mean(axis=1)


@dataclass(frozen=True, eq=False)
class SearchState(FrameState):
    """State of the search in a frame.

    Its problem has one hypothesis per object more than the given one: ``REFINED_BEST``.
    """

    searches: tuple[Search | None, ...] = ()
    """Per cluster; None where no instance has a hypothesis."""


@dataclass(frozen=True)
class PhysimMcts:
    """One tree per cluster, one cluster after another; objects of other clusters add the same amount to every cost."""

    scene: SceneSearch
    settings: MctsSettings

    def start(self, problem: Problem) -> SearchState:
        pools = [self._pool(target) for target in problem.targets]
        instances = [
            replace(instance, hypotheses=pool[0]) for instance, pool in zip(problem.instances, pools, strict=True)
        ]
        problem = replace(problem, instances=tuple(instances))
        shares = [pool[1] for pool in pools]
        objects = [self._begun(t, s) if len(s) else None for t, s in zip(problem.targets, shares, strict=True)]
        return SearchState(problem, tuple(objects), 0, _searches(problem, objects, shares))

    def is_done(self, state: FrameState) -> bool:
        return self._next(_adopted(state)) is None

    def n_iterations(self, state: FrameState) -> int:
        state = _adopted(state)
        searches = [s for s in state.searches if s]
        by_another_method = state.n_done - sum(s.tree.n_expanded for s in searches)
        return by_another_method + sum(map(self._expected, searches))

    def step(self, state: FrameState) -> tuple[FrameState, Iteration]:
        state = _adopted(state)
        k = self._next(state)
        if k is None:
            raise InputError("the run is over: every tree is complete or has used its budget")
        search = state.searches[k]
        assert search is not None
        began = clock()
        done = self.scene.expand(state.problem, state.objects, k, search, state.n_done + 1)
        search = replace(done.search, spent_s=search.spent_s + clock() - began)
        objects = [replace(o, best=done.best[i]) if o and i in done.best else o for i, o in enumerate(state.objects)]
        i = [t.instance.instance_id for t in state.problem.targets].index(done.iteration.instance_id)
        objects[i] = _advanced(objects[i], done.iteration)
        searches = (*state.searches[:k], search, *state.searches[k + 1 :])
        return SearchState(state.problem, tuple(objects), state.n_done + 1, searches), done.iteration

    def edit(self, state: FrameState, instance_id: int, arm: int, T_cam_obj: Float) -> FrameState:
        state = _adopted(state)
        i, o = state.object_to_edit(instance_id)
        score = self.scene.verifier.score(o.target, np.asarray(T_cam_obj, dtype=np.float64)[None])[0]
        edited = o.with_edited(arm, T_cam_obj, score, state.n_done)
        pose = edited.arms[arm].current.T_cam_obj
        lcp = float(overlaps(o.target, pose[None])[0])
        searches = [
            replace(s, tree=s.tree.with_candidate(s.members.index(i), arm, pose, lcp)) if s and i in s.members else s
            for s in state.searches
        ]
        if any(s and i in s.members and self._is_over(s) for s in searches):
            edited = replace(edited, edited_arms=())
        return replace(state.with_object(i, edited), searches=tuple(searches))

    @property
    def verifier(self) -> Verifier:
        return self.scene.verifier

    @property
    def refiner(self) -> Refiner:
        return self.scene.refiner

    def rescored(self, state: FrameState) -> FrameState:
        """
        Raises:
            InputError: always; the scenes whose costs are in the tree are no longer known.
        """
        raise InputError(
            "the score cannot change on the way to or of physim_mcts, whose costs are of whole scenes; "
            "begin again with these settings"
        )

    def _pool(self, target: Target) -> tuple[tuple[Hypothesis, ...], Float]:
        """The instance's hypotheses, with the one of the largest overlap added once more after alignment; and all
        overlaps.
        """
        pool = tuple(h for h in target.instance.hypotheses if h.source != REFINED_BEST)
        if not pool:
            return (), np.zeros(0)
        shares = overlaps(target, np.array([h.T_cam_obj for h in pool]))
        best = pool[int(np.argmax(shares))]
        added = Hypothesis(self.scene.refiner.refine(target, best.T_cam_obj), best.confidence, REFINED_BEST)
        return (*pool, added), np.append(shares, overlaps(target, added.T_cam_obj[None]))

    def _begun(self, target: Target, shares: Float) -> ObjectState:
        """The answer before the first iteration: the hypothesis with the largest overlap."""
        Ts = np.array([h.T_cam_obj for h in target.instance.hypotheses])
        initial = self.scene.verifier.score(target, Ts)
        arms = initial_arms(target.instance.hypotheses, initial)
        first = int(np.argmax(shares))
        return ObjectState(target, initial, arms, arms[first].current.as_best(first))

    def _next(self, state: SearchState) -> int | None:
        """The first cluster with budget left; one with an edited pose goes ahead."""
        under_way = [(k, s) for k, s in enumerate(state.searches) if s and not self._is_over(s)]
        edited = [k for k, s in under_way if any((o := state.objects[i]) and o.edited_arms for i in s.members)]
        return next(iter((*edited, *(k for k, _ in under_way))), None)

    def _budget(self, search: Search) -> int:
        return self.settings.expansions * len(search.members)

    def _is_over(self, search: Search) -> bool:
        if search.tree.is_complete:
            return True
        if self.settings.seconds is not None:
            return search.spent_s >= self.settings.seconds
        return search.tree.n_expanded >= self._budget(search)

    def _expected(self, search: Search) -> int:
        """Iterations that this cluster will take in all; an estimate where the budget is a time."""
        n_done, seconds = search.tree.n_expanded, self.settings.seconds
        if self._is_over(search):
            return n_done
        if seconds is None:
            return search.tree.size(self._budget(search))
        guess = round(n_done * seconds / search.spent_s) if search.spent_s > 0 else self._budget(search)
        return search.tree.size(max(guess, n_done + 1))


def _adopted(state: FrameState) -> SearchState:
    """The state of this search; one that another method left becomes a new search from its current poses."""
    if isinstance(state, SearchState):
        return state
    shares = [
        overlaps(o.target, np.array([arm.current.T_cam_obj for arm in o.arms])) if o else np.zeros(0)
        for o in state.objects
    ]
    return SearchState(state.problem, state.objects, state.n_done, _searches(state.problem, state.objects, shares))


def _searches(
    problem: Problem, objects: Sequence[ObjectState | None], shares: Sequence[Float]
) -> tuple[Search | None, ...]:
    """A new search for each cluster, from the hypotheses' current poses; ``shares`` are their overlaps, per
    instance.
    """
    pools = [
        tuple(Candidate(arm.current.T_cam_obj, lcp) for arm, lcp in zip(o.arms, s.tolist(), strict=True)) if o else ()
        for o, s in zip(objects, shares, strict=True)
    ]
    searches: list[Search | None] = []
    for cluster in clusters_of(problem):
        members = tuple(i for i in cluster if pools[i])
        searches.append(Search(members, SearchTree(tuple(pools[i] for i in members))) if members else None)
    return tuple(searches)


def _advanced(o: ObjectState | None, iteration: Iteration) -> ObjectState:
    """The object after an iteration on one of its arms, rewarded with the score of the accepted pose."""
    accepted = iteration.accepted_stage
    assert o is not None
    assert accepted.score is not None
    entry = AcceptedPose(accepted.T_cam_obj, accepted.score, accepted.name, iteration.index)
    arm = o.arms[iteration.arm].advanced(entry).rewarded(accepted.score.score)
    return o.with_arm(iteration.arm, arm, o.best)


def make_physim_mcts(
    settings: MctsSettings,
    simulator: Simulator | None,
    refiner: Refiner,
    verifier: Verifier,
    renderer: SceneRenderer,
    n_steps: int,
) -> PhysimMcts:
    """The search with its parts.

    Args:
        settings: budget, exploration.
        simulator: made with :func:`mcts_physics`; None switches physics off.
        refiner: trimmed ICP, made with :func:`mcts_tricp`.
        verifier: for the scores that are shown.
        renderer: counts unexplained pixels.
        n_steps: simulation steps per placing.
    """
    scene = SceneSearch(simulator, refiner, verifier, renderer, n_steps, settings.exploration_px)
    return PhysimMcts(scene, settings)
