"""What workers can be asked to do with a frame. By name, so that a worker imports only what it needs, when it may."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Literal, Protocol

from verefine_viz.batch.rows import FrameResult
from verefine_viz.session.toolbox import Toolbox

TaskName = Literal["solve", "explain", "estimate"]
"""solve; solve and say why answers are wrong; initial poses only."""
FrameTask = Callable[[Toolbox, str, Path], FrameResult]
"""(tools, "scene/image", folder of the batch) → result. Never raises because of a bad frame."""


class Workers(Protocol):
    """Where frames are computed: processes of this machine, or a cluster."""

    def solve(self, frames: Iterable[str]) -> Iterator[FrameResult | str | None]:
        """The results of ``frames``, each once, in the order in which they are done; None where none came for a while.

        In between what takes longer than usual, in words, once. ``frames`` are asked for when there is somebody to give
        them to, so they may be any number.
        """
        ...

    def close(self) -> None:
        """Ends the work, also in the middle of a frame."""
        ...

    @property
    def needs(self) -> str:
        """What memory they need, in words; empty while it is not known."""
        ...

    @property
    def warning(self) -> str:
        """What a person should change about their number or memory; empty where all is well."""
        ...


def task_named(name: TaskName) -> FrameTask:
    """The function that a worker runs for each frame."""
    if name == "estimate":
        from verefine_viz.batch.solve_frame import estimate_frame

        return estimate_frame
    from verefine_viz.batch.solve_frame import explain_frame, solve_frame

    return explain_frame if name == "explain" else solve_frame
