"""One side of a comparison: all that a run did, as plain records, wherever they come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Best, Iteration
from verefine_viz.session.engine import Run


@dataclass(frozen=True, eq=False)
class Trace:
    """A run from the outside: what it started from, what it did, and its answers on the way."""

    problem: Problem
    initial: Mapping[int, tuple[float, ...]]
    """Scores of the hypotheses before iteration 1, by instance_id; none where the pool is empty."""
    iterations: tuple[Iteration, ...]
    """1, 2, …"""
    answers: tuple[Mapping[int, Best], ...]
    """By instance_id, after 0, 1, 2, … iterations; an object without hypotheses has none."""
    n_planned: int
    """Iterations that the whole run will have."""

    @property
    def is_done(self) -> bool:
        """Whether nothing more will come."""
        return len(self.iterations) >= self.n_planned

    @property
    def instance_ids(self) -> tuple[int, ...]:
        return tuple(i.instance_id for i in self.problem.instances)

    @cached_property
    def own(self) -> Mapping[int, tuple[Iteration, ...]]:
        """The iterations of each instance, by instance_id."""
        found: dict[int, list[Iteration]] = {i: [] for i in self.instance_ids}
        for iteration in self.iterations:
            found.setdefault(iteration.instance_id, []).append(iteration)
        return {i: tuple(own) for i, own in found.items()}


def trace_of(run: Run) -> Trace:
    """All that ``run`` did so far."""
    problem = run.problem
    ids = [i.instance_id for i in problem.instances]
    states = [run.state_at(k) for k in range(run.length + 1)]
    initial = {
        i: tuple(float(s) for s in scores.score) if scores is not None else ()
        for i, scores in zip(ids, states[0].initial, strict=True)
    }
    answers = tuple({i: best for i, best in zip(ids, state.best, strict=True) if best is not None} for state in states)
    planned = run.length if run.is_done else max(run.n_iterations, run.length + 1)
    return Trace(problem, initial, run.iterations, answers, planned)


def refiner_calls(iteration: Iteration) -> int:
    """Calls of the refiner that an iteration spent on its own object.

    Those that only complete a scene in a roll-out are not counted, as in the paper's comparison with PHYSIM-MCTS
    (docs/methods.md 3.3); :func:`rollout_calls` has them.
    """
    return sum(stage.name == "refined" for stage in iteration.stages)


def rollout_calls(iteration: Iteration) -> int:
    """Calls of the refiner that only completed a scene."""
    return len(iteration.tree.rollout) if iteration.tree is not None else 0
