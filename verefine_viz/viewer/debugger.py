"""The debugger without a screen: carries out commands, one after another, on one thread.

The page is one way to drive it; a list of commands is another, with the same result (:meth:`Debugger.carry_out`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.records import Iteration
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.handlers import batch, comparing, editing, looking, navigation, opening
from verefine_viz.viewer.snapshot.build import snapshot_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.state import State

HANDLERS: dict[type[c.Command], Callable[[State, Any], None]] = {
    **navigation.HANDLERS,
    **opening.HANDLERS,
    **batch.HANDLERS,
    **looking.HANDLERS,
    **editing.HANDLERS,
    **comparing.HANDLERS,
}
"""By command: what carries it out."""


class Debugger(State):
    """A state that commands are applied to. Handlers see the state alone."""

    def apply(self, command: c.Command) -> None:
        """Begins to carry out a command; a run goes on with each :meth:`tick`.

        Raises:
            VerefineError: it cannot be done; everything is as before.
            Cancelled: it is no longer wanted; everything is as before.
        """
        self.message, self.refused, self.offer = "", False, None
        if isinstance(command, c.TogglePause):
            command = c.Pause() if self.is_busy else c.RunUntil("end")
        command = batch.resolved(self, command)
        editing.refuse_loss(self, command)
        self.log.extend(self.comparison.progress())
        if not command.keeps_b_running:
            self.pause_b()
        if not command.runs_beside:
            self.pause()
        if type(command) not in HANDLERS:
            raise InputError(unknown("command", type(command).__name__, [kind.__name__ for kind in HANDLERS]))
        HANDLERS[type(command)](self, command)
        self.log.extend(command.logged(self.run.cursor))

    def carry_out(self, commands: Iterable[c.Command]) -> Debugger:
        """Every command in order, each to its end."""
        for command in commands:
            self.apply(command)
            while self.is_busy:
                self.tick()
        return self

    def tick(self) -> Iteration | None:
        """One iteration of the open run, or else of B; None where the open one has none to make."""
        if self.running.goal is not None:
            return navigation.tick(self)
        comparing.tick_b(self)
        return None

    @property
    def is_busy(self) -> bool:
        """Whether a run is on, be it A's or B's."""
        return self.running.goal is not None or self.comparison.is_running

    def view(self, deep: bool = True) -> Snapshot:
        """What is to be seen now; if not ``deep`` without score maps, and plausibility only of an edited pose."""
        return snapshot_of(self, deep)
