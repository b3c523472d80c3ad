"""Runs to compare: real methods on stand-in parts, and histories made up call by call."""

from __future__ import annotations

from functools import cache

from tests.changing import replace
from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import MethodSettings
from verefine_viz.methods.registry import make_method
from verefine_viz.run.compare import Trace, trace_of
from verefine_viz.run.engine import Run

METHODS = ("refine", "pir", "sir", "rir", "even", "expl")


def run_of(name: str = "rir", n_instances: int = 1, problem: Problem | None = None, **fields: object) -> Run:
    """A run that is not yet stepped."""
    settings = MethodSettings.model_validate({"name": name, "iterations": 2, **fields})
    method = make_method(settings, FakeSimulator(), FakeRefiner(), FakeVerifier(), 3)
    return Run(method, problem or box_problem(n_hypotheses=3, n_instances=n_instances, seed=3))


def trace(name: str = "rir", n_instances: int = 1, **fields: object) -> Trace:
    """A run to its end."""
    run = run_of(name, n_instances, **fields)
    run.finish()
    return trace_of(run)


@cache
def _template(n_instances: int) -> Trace:
    return trace("sir", n_instances)


def made_up(order: list[tuple[int, bool]], n_instances: int = 3, n_planned: int | None = None) -> Trace:
    """A history that works on these instances in this order, each time with or without a refiner call."""
    template = _template(n_instances)
    iterations: list[Iteration] = []
    for k, (own, refines) in enumerate(order, 1):
        record = replace(template.own[own][0], index=k)
        if not refines:
            record = replace(record, stages=record.stages[:2], accepted=record.stages[1].name)
        iterations.append(record)
    answers = tuple(template.answers[0] for _ in range(len(order) + 1))
    return Trace(template.problem, template.initial, tuple(iterations), answers, n_planned or len(order))
