"""One iteration of PHYSIM-MCTS on one cluster: select, expand, complete the scene, back up. docs/methods.md 3.3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.clock import clock
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.core.protocols import Refiner, SceneRenderer, Simulator, Verifier
from verefine_viz.core.records import Best, Event, Iteration, PlacedPose, Stage, TreeNode, TreeStep
from verefine_viz.methods.arms import ObjectState
from verefine_viz.methods.events import events_of
from verefine_viz.methods.search_tree import SearchTree
from verefine_viz.methods.single_object import Draft, refined, simulate

NOT_OF_A_SEARCH = ("arm_switched", "new_best", "physics_worse")
"""Events without meaning here: every iteration takes another arm, no single object has a best score, and physics runs
for so long that an object's own score falls far in every other iteration."""


@dataclass(frozen=True, eq=False)
class Search:
    """State of the search in one cluster."""

    members: tuple[int, ...]
    """Indices of its instances that have a hypothesis, in the order of placing."""
    tree: SearchTree
    incumbent: tuple[PlacedPose, ...] = ()
    """The complete scene with the lowest cost ever seen; empty before the first iteration."""
    incumbent_px: float = np.inf
    spent_s: float = 0.0
    """Computing time so far [s]."""


@dataclass(frozen=True, eq=False)
class Placing:
    """An object's placement, and the poses that led to it."""

    placed: Placed
    arm: int
    draft: Draft


@dataclass(frozen=True, eq=False)
class Expansion:
    """Outcome of one iteration."""

    search: Search
    iteration: Iteration
    best: dict[int, Best]
    """New answers by instance index, where the incumbent changed."""


@dataclass(frozen=True)
class SceneSearch:
    """Places objects and evaluates scenes."""

    simulator: Simulator | None
    refiner: Refiner
    """Trimmed ICP; leaves out the points that already placed objects explain."""
    verifier: Verifier
    """Its scores are only shown; the search goes by the cost."""
    renderer: SceneRenderer
    n_steps: int
    exploration_px: float

    def expand(
        self, problem: Problem, objects: Sequence[ObjectState | None], cluster: int, search: Search, index: int
    ) -> Expansion:
        """One iteration.

        Args:
            problem: the frame.
            objects: per instance.
            cluster: its number, for the record.
            search: its state in the cluster.
            index: of the iteration, over the whole run.
        """
        tree = search.tree
        selection = tree.select(self.exploration_px, _edited(objects, search))
        above = [tree.nodes[n] for n in selection.branch[1:]]
        level, arm = len(above), selection.arm
        o = objects[search.members[level]]
        assert o is not None
        fixed = [_placed(problem, i, node.T_cam_obj) for i, node in zip(search.members[:level], above, strict=True)]
        new = self._place(problem, search, level, arm, fixed)

        started = clock()
        rest = self._completed(problem, objects, search, (*fixed, new.placed))
        scene = (*fixed, new.placed, *(p.placed for p in rest))
        cost_px = float(self.renderer.unexplained_px(problem.observation, scene))
        branch = (*selection.branch, len(tree.nodes))
        grown = tree.expanded(selection.branch[-1], arm, new.placed.T_cam_obj).backed_up(branch, cost_px)
        after = replace(search, tree=grown)
        poses = tuple(PlacedPose(p.instance_id, p.T_cam_obj) for p in scene)
        best: dict[int, Best] = {}
        if cost_px < search.incumbent_px:
            after = replace(after, incumbent=poses, incumbent_px=cost_px)
            arms = (*(node.arm for node in above), arm, *(p.arm for p in rest))
            best = self._answers(problem, search, scene, arms, index, new.draft.stages[-1])
        start = Stage("current", tree.pools[level][arm].T_cam_obj)
        stages = self._scored(o, (start, *new.draft.stages), fixed)
        score_ms = (clock() - started) * 1e3

        lcp = tree.pools[level][arm].lcp
        node = TreeNode(branch[-1], branch[-2], new.placed.instance_id, arm, lcp, new.placed.T_cam_obj)
        step = TreeStep(
            cluster,
            branch,
            node,
            selection.choices,
            poses[level + 1 :],
            tuple(p.arm for p in rest),
            cost_px,
            after.incumbent,
            after.incumbent_px,
        )
        iteration = Iteration(
            index,
            new.placed.instance_id,
            new.placed.model.obj_id,
            arm,
            o.arms[arm].n_iterations + 1,
            stages,
            stages[-1].name,
            best.get(search.members[level], o.best),
            new.draft.path,
            placed=poses[:level],
            tree=step,
            score_ms=score_ms,
        )
        events = [e for e in events_of(iteration, new.draft, o) if e.kind not in NOT_OF_A_SEARCH]
        if best:
            was = f", was {search.incumbent_px:.0f}" if search.incumbent else ""
            events.append(Event("new_best_scene", f"New best scene: {cost_px:.0f} px unexplained{was}."))
        return Expansion(after, structs.replace(iteration, events=tuple(events)), best)

    def _place(self, problem: Problem, search: Search, level: int, arm: int, fixed: Sequence[Placed]) -> Placing:
        """Run trimmed ICP from the hypothesis, then physics, both among the objects already placed."""
        i = search.members[level]
        target, T_cam_obj = problem.targets[i], search.tree.pools[level][arm].T_cam_obj
        aligned = refined(self.refiner, target, T_cam_obj, fixed)
        settled = simulate(self.simulator, target, aligned.T_cam_obj, fixed, self.n_steps)
        if settled is None:
            draft = Draft((aligned,), ("refined",), lacks_physics=True)
        else:
            draft = Draft((aligned, settled[0]), ("simulated",), settled[1])
        return Placing(_placed(problem, i, draft.stages[-1].T_cam_obj), arm, draft)

    def _completed(
        self, problem: Problem, objects: Sequence[ObjectState | None], search: Search, scene: Sequence[Placed]
    ) -> list[Placing]:
        """The roll-out: the other objects, each from its hypothesis with the largest LCP, or an edited one."""
        rest: list[Placing] = []
        for level in range(len(scene), len(search.members)):
            so_far = (*scene, *(p.placed for p in rest))
            o = objects[search.members[level]]
            arm = o.edited_arms[0] if o and o.edited_arms else search.tree.favourite(level)
            rest.append(self._place(problem, search, level, arm, so_far))
        return rest

    def _answers(
        self, problem: Problem, search: Search, scene: Sequence[Placed], arms: Sequence[int], index: int, last: Stage
    ) -> dict[int, Best]:
        """The poses of a new incumbent as answers, each scored among the others."""
        best: dict[int, Best] = {}
        for i, arm, placed in zip(search.members, arms, scene, strict=True):
            score = self.verifier.score(problem.targets[i], placed.T_cam_obj[None], scene)[0]
            best[i] = Best(placed.T_cam_obj, score, arm, index, last.name)
        return best

    def _scored(self, o: ObjectState, stages: tuple[Stage, ...], fixed: Sequence[Placed]) -> tuple[Stage, ...]:
        scores = self.verifier.score(o.target, np.array([s.T_cam_obj for s in stages]), fixed)
        return tuple(s.with_score(scores[j]) for j, s in enumerate(stages))


def _edited(objects: Sequence[ObjectState | None], search: Search) -> tuple[int, int] | None:
    """(level, arm) of the first hypothesis that was edited and has not been placed since."""
    members = ((level, objects[i]) for level, i in enumerate(search.members))
    return next(((level, o.edited_arms[0]) for level, o in members if o and o.edited_arms), None)


def _placed(problem: Problem, i: int, T_cam_obj: Float | None) -> Placed:
    assert T_cam_obj is not None, "only the root has no pose"
    target = problem.targets[i]
    return Placed(target.instance.instance_id, target.model, T_cam_obj)
