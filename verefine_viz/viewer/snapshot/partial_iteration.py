"""How much of the iteration at the cursor is shown: all of it, up to a stage, or instead of it the run's answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from verefine_viz.core.records import Iteration
from verefine_viz.methods.registry import SEARCH
from verefine_viz.session.engine import Run
from verefine_viz.viewer.state.view_options import ViewOptions

if TYPE_CHECKING:
    pass


def is_partial(run: Run, look: ViewOptions) -> bool:
    """Whether the iteration at the cursor is shown up to a stage before its last one."""
    return run.iteration is not None and look.stage in [stage.name for stage in run.iteration.stages[:-1]]


def revealed(iteration: Iteration, stage: str | None) -> tuple[str, ...]:
    """The stages of an iteration up to ``stage``; all of them for None or where it has no such stage."""
    names = tuple(s.name for s in iteration.stages)
    return names[: names.index(stage) + 1] if stage in names else names


# The end of a finished run shows its answer. What was tried last belongs to the last iteration, and can be asked for.
#
# Which of the two is shown follows from the cursor and the look: the answer, unless a stage, a simulated path or an
# edited pose is looked at.

OF_ITERATION = frozenset({"current", "simulated", "mixed", "refined", "accepted"})
"""Poses that an iteration goes through."""


def is_answer(run: Run, look: ViewOptions) -> bool:
    """Whether the answer is shown."""
    beside = look.stage is None and look.path_pose is None and look.edited is None
    return run.at_end and run.length > 0 and beside


def is_of_best_scene(method: str, own: Sequence[Iteration], answer: bool) -> bool:
    """Whether the best pose of an object is its part of the best scene: always in a tree search, and where ``own``
    iterations belong to passes over several objects at the end (``answer``).
    """
    return method == SEARCH or (answer and any(i.scene_pass is not None for i in own))


def answered(look: ViewOptions) -> ViewOptions:
    """``look`` where the answer is shown: without poses of the iteration, and the answer compared with its start."""
    a, b = look.a, look.b
    if b in OF_ITERATION:
        a, b = "initial" if a == "best" else a, "best"
    if a in OF_ITERATION:
        a = "best" if b != "best" else "initial"
    return replace(look, a=a, b=b, layers=look.layers - OF_ITERATION | {"best"})
