"""Runs to compare: real methods on stand-in parts, runs of which something is changed, and runs made up by object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import msgspec

from tests.changing import replace
from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import MethodSettings
from verefine_viz.methods.registry import make_method
from verefine_viz.run.engine import Run

METHODS = ("refine", "pir", "sir", "rir", "even", "expl")


def run_of(name: str = "rir", n_instances: int = 1, problem: Problem | None = None, **fields: object) -> Run:
    """A run that is not yet stepped."""
    settings = msgspec.convert({"name": name, "iterations": 2, **fields}, MethodSettings)
    method = make_method(settings, FakeSimulator(), FakeRefiner(), FakeVerifier(), 3)
    return Run(method, problem or box_problem(n_hypotheses=3, n_instances=n_instances, seed=3))


def finished(name: str = "rir", n_instances: int = 1, **fields: object) -> Run:
    """A run to its end."""
    run = run_of(name, n_instances, **fields)
    run.finish()
    return run


@dataclass(frozen=True)
class GivenState:
    """The state after some of the given iterations."""

    problem: Problem
    initial: tuple[Scores | None, ...]
    best: tuple[Best | None, ...]
    n_done: int = 0


class Given:
    """A method whose states and iterations are given."""

    def __init__(self, start: GivenState, iterations: Sequence[Iteration], n_planned: int) -> None:
        self._start, self._iterations, self._n_planned = start, iterations, n_planned

    def start(self, problem: Problem) -> GivenState:
        return self._start

    def step(self, state: GivenState) -> tuple[GivenState, Iteration]:
        made = self._iterations[state.n_done]
        ids = [i.instance_id for i in state.problem.instances]
        best = tuple(made.best if own == made.instance_id else b for own, b in zip(ids, state.best, strict=True))
        return replace(state, best=best, n_done=state.n_done + 1), made

    def is_done(self, state: GivenState) -> bool:
        return state.n_done >= self._n_planned

    def n_iterations(self, state: GivenState) -> int:
        return self._n_planned


def altered(run: Run, iterations: Sequence[Iteration] | None = None, n_planned: int | None = None, **start: Any) -> Run:
    """A run with other iterations, or with another problem, initial scores or best poses before the first."""
    first = run.state_at(0)
    given = run.iterations if iterations is None else iterations
    state = replace(GivenState(first.problem, first.initial, first.best), **start)
    method: Any = Given(state, given, len(given) if n_planned is None else n_planned)
    other = Run(method, state.problem)
    for _ in given:
        other.step()
    return other


@cache
def _template(n_instances: int) -> Run:
    return finished("sir", n_instances)


def made_up(order: Sequence[int], n_instances: int = 3, n_planned: int | None = None) -> Run:
    """A run that works on these instances in this order."""
    template = _template(n_instances)
    iterations = [replace(template.iterations_of(own)[0], index=k) for k, own in enumerate(order, 1)]
    return altered(template, iterations, n_planned)
