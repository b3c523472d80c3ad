"""How much of the iteration at the cursor is shown: all of it, up to a stage, or instead of it the run's answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from verefine_viz.core.records import Iteration
from verefine_viz.methods.registry import method_of
from verefine_viz.session.engine import Run
from verefine_viz.viewer.state.view_options import ViewOptions

if TYPE_CHECKING:
    pass


def is_partial(run: Run, options: ViewOptions) -> bool:
    """Whether the iteration at the cursor is shown up to a stage before its last one."""
    return run.iteration is not None and options.stage in [stage.name for stage in run.iteration.stages[:-1]]


def revealed(iteration: Iteration, stage: str | None) -> tuple[str, ...]:
    """The stages of an iteration up to ``stage``; all of them for None or where it has no such stage."""
    names = tuple(s.name for s in iteration.stages)
    return names[: names.index(stage) + 1] if stage in names else names


# The end of a finished run shows its answer. What was tried last belongs to the last iteration, and can be asked for:
# the answer is shown unless a stage, a simulated path or an edited pose is looked at.

OF_ITERATION = frozenset({"current", "simulated", "mixed", "refined", "accepted"})
"""Poses that an iteration goes through."""


def is_answer(run: Run, options: ViewOptions) -> bool:
    """Whether the answer is shown."""
    beside = options.stage is None and options.path_pose is None and options.edited is None
    return run.at_end and run.length > 0 and beside


def is_of_best_scene(method: str, own: Sequence[Iteration], answer: bool) -> bool:
    """Whether the best pose of an object is its part of the best scene: always in a tree search, and where ``own``
    iterations belong to passes over several objects at the end (``answer``).
    """
    return method_of(method).has_tree or (answer and any(i.scene_pass is not None for i in own))


def answered(options: ViewOptions) -> ViewOptions:
    """``options`` where the answer is shown: without poses of the iteration, and the answer compared with its start."""
    a, b = options.a, options.b
    if b in OF_ITERATION:
        a, b = "initial" if a == "best" else a, "best"
    if a in OF_ITERATION:
        a = "best" if b != "best" else "initial"
    return replace(options, a=a, b=b, layers=options.layers - OF_ITERATION | {"best"})
