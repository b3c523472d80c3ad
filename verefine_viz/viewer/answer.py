"""The end of a finished run shows its answer. What was tried last belongs to the last iteration, and can be asked for.

Which of the two is shown follows from the cursor and the look: the answer, unless a stage, a simulated path or an
edited pose is looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from verefine_viz.core.records import Iteration
from verefine_viz.methods.registry import SEARCH
from verefine_viz.session.engine import Run
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.look import Look

if TYPE_CHECKING:
    from verefine_viz.viewer.view import View

OF_ITERATION = frozenset({"current", "simulated", "mixed", "refined", "accepted"})
"""Poses that an iteration goes through."""


def is_answer(run: Run, look: Look) -> bool:
    """Whether the answer is shown."""
    beside = look.stage is None and look.path_pose is None and look.edited is None
    return run.at_end and run.length > 0 and beside


def is_of_best_scene(method: str, own: Sequence[Iteration], answer: bool) -> bool:
    """Whether the best pose of an object is its part of the best scene: always in a tree search, and where ``own``
    iterations belong to passes over several objects at the end (``answer``).
    """
    return method == SEARCH or (answer and any(i.scene_pass is not None for i in own))


def answered(look: Look) -> Look:
    """``look`` where the answer is shown: without poses of the iteration, and the answer compared with its start."""
    a, b = look.a, look.b
    if b in OF_ITERATION:
        a, b = "initial" if a == "best" else a, "best"
    if a in OF_ITERATION:
        a = "best" if b != "best" else "initial"
    return replace(look, a=a, b=b, layers=look.layers - OF_ITERATION | {"best"})


def asked(look: Look | None, command: c.Command, run: Run, now: Look) -> Look | None:
    """The look after a command that may ask for something of the last iteration where its answer is shown (``now``)."""
    if look is None or run.iteration is None or not is_answer(run, now):
        return look
    last = run.iteration.stages[-1].name
    match command:
        case c.ShowLayer(name, visible) if name in OF_ITERATION and visible is not False:
            return replace(now, layers=now.layers | {name}, stage=last)
        case c.ShowLayer("best", visible) if visible is not True:
            return replace(now, layers=now.layers - {"best"}, stage=last)
        case c.Compare(a, b) if OF_ITERATION & {a, b}:
            return replace(look, stage=last)
    return look


def visit(view: View, iteration: Iteration) -> c.Command:
    """Goes to an iteration, also to the last one of a finished run, where the end would show the answer."""
    p = view.progress
    if iteration.index == p.done == p.total:
        return c.SeekStage(iteration.index, iteration.stages[-1].name)
    return c.Seek(iteration.index)


def the_answer(view: View) -> str:
    """As in: the answer, of iteration 16. Plain text; the objects of a frame are each of another."""
    if view.is_whole_scene:
        return "the answer"
    answer = view.scene.object(view.target.instance.instance_id).answer
    if answer is None:
        return "no answer"
    own = f"of iteration {answer.iteration}" if answer.iteration else "a first pose"
    if len(view.scene.objects) > 1:
        return f"the answer; {view.scene.object(view.target.instance.instance_id).label}: {own}"
    return f"the answer, {own}"


def beside_answer(view: View) -> str:
    """Where the answer is shown: of which iteration the numbers are that belong to one; empty elsewhere."""
    answer = view.scene.object(view.target.instance.instance_id).answer
    if not view.is_answer or view.shown is None or answer is None:
        return ""
    last = f"iteration {view.shown.index}, the last one on it"
    if answer.iteration == view.shown.index:
        return f"The answer is of {last}. "
    own = f"of iteration {answer.iteration}" if answer.iteration else "a first pose"
    return f"The answer is {own}; told here is {last}. "
