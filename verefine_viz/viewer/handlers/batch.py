"""Which answer of a batch is open, and how the next one is found."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.settings import Session
from verefine_viz.session.engine import Run
from verefine_viz.viewer.commands import Command, OpenAt, OpenFailure, OpenPoint
from verefine_viz.viewer.drawing.score_plot import plot_of
from verefine_viz.viewer.state.gallery import PAGE, Entry, Gallery
from verefine_viz.viewer.state.view_options import ViewOptions

if TYPE_CHECKING:
    from verefine_viz.viewer.state.workspace import Workspace


class Browsing:
    """The gallery and the place in it.

    Args:
        gallery: None = no batch was opened.
        workspace: where frames are opened.
    """

    def __init__(self, gallery: Gallery | None, workspace: Workspace) -> None:
        self.gallery, self._workspace = gallery, workspace
        self._run = gallery.worst.run if gallery is not None else ""
        self._last: Entry | None = None
        self._asked: tuple[Run, int] | None = None

    def resolved(self, command: Command, look: ViewOptions) -> Command:
        """The opening that a command about the gallery stands for; any other command as it is.

        Raises:
            InputError: there is no such answer.
        """
        if not isinstance(command, OpenFailure | OpenPoint):
            return command
        if self.gallery is None:
            raise InputError("no batch is open; open one with verefine-viz view FOLDER")
        if isinstance(command, OpenPoint):
            found = plot_of(self.gallery, look.batch_only).nearest(command.u, command.v)
            if found is None:
                raise InputError("no object there; click nearer to a point")
            return self.gallery.opens(found)
        return self.gallery.opens(self._following(self.gallery, look, command.direction))

    def _following(self, gallery: Gallery, look: ViewOptions, direction: int) -> Entry:
        shown = [entry for entry in gallery.shown(look.batch_order, look.batch_only) if entry.can_be_opened]
        if not shown:
            raise InputError("no answer passes all filters; choose other filters")
        if self._last not in shown:
            return shown[0 if direction > 0 else -1]
        place = shown.index(self._last) + direction
        if not 0 <= place < len(shown):
            raise InputError(f"that is the {'last' if direction > 0 else 'first'} answer of the list")
        return shown[place]

    def enter(self, command: OpenAt) -> None:
        """Opens the frame, with the session of its run if another one is open; of several branches the run itself.

        Raises:
            InputError: no such run or frame.
        """
        gallery = self.gallery
        if command.run and (gallery is None or command.run not in gallery.runs):
            raise InputError(unknown("run", command.run, gallery.runs if gallery else ()))
        run = command.run or self._run
        if gallery is None or self._workspace.tools.session == gallery.session(run):
            self._workspace.open_frame(command.frame)
        else:
            self._workspace.open(gallery.session(run), None, command.frame)
        if gallery is not None:
            self._run = run
            if self._workspace.work.sides is None:
                self._workspace.work.index = 0
            self._last = gallery.entry(run, command.frame, command.instance)
        self._asked = self._workspace.run, command.iteration

    def look(self, look: ViewOptions, command: OpenAt) -> ViewOptions:
        """``look`` with the object in focus, at the iteration, and on the gallery's page that holds it."""
        ids = [i.instance_id for i in self._workspace.work.problem.instances]
        look = replace(look, focus=command.instance if command.instance in ids else None)
        shown = self.gallery.shown(look.batch_order, look.batch_only) if self.gallery else ()
        look = replace(look, batch_page=shown.index(self._last) // PAGE) if self._last in shown else look
        return replace(look, stage=self.stage_asked_for(self._workspace.run.cursor))

    def stage_asked_for(self, iteration: int) -> str | None:
        """What shows the iteration that was asked for itself where the end of the run would show its answer."""
        run = self._workspace.run
        if self._asked != (run, iteration) or not run.at_end or run.iteration is None:
            return None
        return run.iteration.stages[-1].name

    def entry(self, instance_id: int) -> Entry | None:
        """What the batch says about an object of the open frame; None where something else is open."""
        gallery = self.gallery
        if gallery is None or not self._is_open(gallery.session(self._run)):
            return None
        return gallery.entry(self._run, self._workspace.frame, instance_id)

    def _is_open(self, session: Session) -> bool:
        """Whether the page shows frames of this session, be it with another method by now."""
        now = self._workspace.tools.session
        there, here = (s.scene.model_copy(update={"frames": ()}) for s in (session, now))
        return there == here and session.hypotheses == now.hypotheses
