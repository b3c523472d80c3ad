"""What the page shows of a debugger: what the user needs first at once, and the rest when nothing else waits."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from time import monotonic
from typing import Literal

from verefine_viz.core.errors import Cancelled, VerefineError
from verefine_viz.refiners.registry import raised_by_refiner
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.busy_status import BusyStatus
from verefine_viz.viewer.debugger import STOP, Debugger, RequestQueue
from verefine_viz.viewer.grasp_commands import PlayGrasp, TryGrasp
from verefine_viz.viewer.panels.page_layout import Layout
from verefine_viz.viewer.scene3d.object_nodes import ComparisonNodes
from verefine_viz.viewer.scene3d.scene_view import SceneView, look_again
from verefine_viz.viewer.snapshot.build import (
    deferred_landscape,
    deferred_physics,
    deferred_turns,
    lacks_landscape,
    lacks_turns,
    plausibility_stages,
)
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.batch_gallery import Gallery
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator
from verefine_viz.viewer.state.state import Unconfirmed
from verefine_viz.viewer.web.server import Server

_LOG = logging.getLogger(__name__)
REFRESH_S = 0.12
"""Time between two pictures while a run is on [s]."""
CANCELLED = "Cancelled: everything is as it was before."

FRAME_S = 1 / 25
"""Time between two pictures of an animation, and from words to the picture that goes with them [s]."""
CALM_S = 0.25
"""What is shown sooner after the last comes with its picture [s]: the user drags a slider."""
_END = object()


class Page:
    """3D scene and panels of one session.

    Args:
        server: where they are shown.
        debugger: whose snapshot they show.
        requests: takes what the user asks for.
        batch: whose answers the gallery shows; None = no batch.
    """

    def __init__(self, server: Server, debugger: Debugger, requests: RequestQueue, batch: Gallery | None) -> None:
        self._server, self._debugger, self._requests = server, debugger, requests
        self.scene = SceneView(server, requests.send)
        self.comparison = ComparisonNodes(server)
        several = len(debugger.workspace.work.problem.instances) > 1
        self.layout = Layout(server, requests.send, lambda client: look_again(server, client), several, batch)
        self.layout.on_link(requests.send)
        if self.layout.gallery is not None:
            server.picture = self.layout.gallery.picture
        self._shown_at = 0.0
        self._snapshot: Snapshot | None = None
        self._left: Literal["maps", "picture"] | None = None
        self._image_waits = False
        self._animation: Iterator[None] | None = None
        self._later: Iterator[None] | None = None

    @property
    def age_s(self) -> float:
        """How long ago it was drawn [s]."""
        return monotonic() - self._shown_at

    @property
    def wait_s(self) -> float | None:
        """How long it is complete without :meth:`go_on` [s]; None = until something is asked for."""
        if self._image_waits or self._left == "maps":
            return 0
        if self._left == "picture":
            return max(FRAME_S - self.age_s, 0)
        if self._animation is not None:
            return FRAME_S
        return None if self._later is None else 0

    def show(self, with_picture: bool = False, with_maps: bool = True) -> None:
        """Words and numbers at once; what takes longer is left to :meth:`go_on`.

        Of an object that is shown already score maps come at once too, and the photo's layers and the picture in 3D are
        left: a browser without a GPU takes its time for that, and would not show anything before.

        Args:
            with_picture: leave that by no means; there is more to do.
            with_maps: whether those follow it; False = they could not be made.
        """
        snapshot = self._debugger.view(deep=False)
        hurries = (
            with_picture or self._left == "picture" or self.age_s < CALM_S or not _is_known(snapshot, self._snapshot)
        )
        self._left = "picture" if not hurries else "maps" if with_maps else None
        self._snapshot = snapshot if hurries else self._debugger.view()
        slider_is_ahead = self._requests.holds(c.Seek)
        with self._server.atomic():
            if hurries:
                self._draw(self._snapshot)
                self.layout.image.show(self._snapshot)
            self.layout.show(self._snapshot, slider_is_ahead)
        self._image_waits = not hurries
        self._server.flush()
        self._shown_at = monotonic()

    def show_gallery(self) -> None:
        """What arrived in a folder that is watched; everything else is left as it is."""
        snapshot = self._debugger.view(deep=False)
        with self._server.atomic():
            self.layout.show_gallery(snapshot)
        self._server.flush()

    def animate(self, command: c.Command, before: int) -> None:
        """Has what a command did shown picture by picture, where it is to be; ``before`` was the cursor before it."""
        snapshot = self._snapshot
        assert snapshot is not None
        stepped = isinstance(command, c.Step) and snapshot.cursor == before + 1
        if stepped and snapshot.options.animate and snapshot.is_current:
            self._animation = self.scene.animation(snapshot)
        elif isinstance(command, c.PlayPath):
            self._animation = self.scene.path_animation(snapshot)
        elif isinstance(command, TryGrasp | PlayGrasp):
            if isinstance(command, TryGrasp):
                self.scene.look_at_grasp(snapshot)
            self._animation = self.scene.grasp_animation(snapshot)

    def move_camera(self, command: c.Command) -> None:
        """Moves the 3D view of the browser that asked for it."""
        client = self._server.get_clients().get(command.client or 0) if isinstance(command, c.MoveCamera) else None
        if client is not None and isinstance(command, c.MoveCamera) and self._snapshot is not None:
            self.scene.move_camera(client, command.to, self._snapshot)

    def go_on(self) -> None:
        """One thing more: the photo, score maps or the picture in 3D, one of an animation, or physics of the scene."""
        if self._image_waits:
            self._show_image()
        elif self._left is not None:
            self._show_left()
        elif self._animation is not None:
            if next(self._animation, _END) is _END:
                self._animation = None
        elif self._later is not None and next(self._later, _END) is _END:
            self._later = None
            self._show_physics()

    def show_run(self) -> None:
        """The words of the Run panel again, in whose place something else was said."""
        assert self._snapshot is not None
        self.layout.run.show(self._snapshot)
        self._server.flush()

    def leave_off(self) -> None:
        """Something else is to be shown: what is left of animation and physics is of no use."""
        self._animation = self._later = None

    def _draw(self, snapshot: Snapshot) -> None:
        self.scene.show(snapshot)
        self.comparison.show(snapshot)

    def _show_image(self) -> None:
        self._image_waits = False
        assert self._snapshot is not None
        with self._server.atomic():
            self.layout.image.show(self._snapshot)
        self._server.flush()

    def _show_left(self) -> None:
        left, self._left = self._left, None
        if left == "maps":
            self._snapshot = self._debugger.view()
        snapshot = self._snapshot
        assert snapshot is not None
        with self._server.atomic():
            if left == "picture":
                self._draw(snapshot)
            else:
                self.scene.show_deep(snapshot)
                self.layout.show_deep(snapshot)
                self._image_waits = True
        self._server.flush()
        # In the gallery it is not seen, and pictures need the time.
        in_gallery = snapshot.options.preset == "gallery"
        self._later = None if in_gallery else _deferred(snapshot, self._debugger.workspace.branch.evaluator)

    def _show_physics(self) -> None:
        """What was worked out about the whole scene."""
        snapshot = self._debugger.view()
        with self._server.atomic():
            self.scene.show_physics(snapshot)
            self.layout.show_physics(snapshot)
        self._server.flush()


def _is_known(snapshot: Snapshot, shown: Snapshot | None) -> bool:
    """Whether it is of the frame and object that are shown already."""
    return (
        shown is not None
        and snapshot.problem is shown.problem
        and snapshot.target.instance.instance_id == shown.target.instance.instance_id
    )


def _deferred(snapshot: Snapshot, evaluator: CachedEvaluator) -> Iterator[None] | None:
    """What takes longest, one thing per turn: the score around the answer, the scene's physics; None = all is known."""
    wanted = []
    if lacks_turns(snapshot, evaluator):
        wanted.append(deferred_turns(snapshot, evaluator))
    if lacks_landscape(snapshot, evaluator):
        wanted.append(deferred_landscape(snapshot, evaluator))
    if not snapshot.physics.complete or _lacks_plausibility(snapshot):
        wanted.append(deferred_physics(snapshot, evaluator))
    return chain(*wanted) if wanted else None


def _lacks_plausibility(snapshot: Snapshot) -> bool:
    """Whether the plausibility of the poses in focus is still to be worked out."""
    missing = any(name not in snapshot.plausible for name in plausibility_stages(snapshot.poses))
    return missing and snapshot.target.observation.support is not None


class Worker:
    """Takes one command after another, has the debugger carry it out and the page show what came of it.

    Args:
        page: of the debugger.
        debugger: carries commands out.
        requests: where they come from.
        busy: says what is being done.
    """

    def __init__(self, page: Page, debugger: Debugger, requests: RequestQueue, busy: BusyStatus) -> None:
        self._page, self._debugger, self._requests, self._busy = page, debugger, requests, busy
        requests.view_meanwhile = self._view_meanwhile

    def work(self) -> None:
        """Until the program is stopped."""
        with suppress(Cancelled):
            while (command := self._requests.take(0 if self._debugger.is_busy else self._page.wait_s)) is not STOP:
                self._try_to_carry_out(command)

    def _try_to_carry_out(self, command: c.Command | object | None) -> None:
        only_shows = not isinstance(command, c.Command) and not self._debugger.is_busy
        try:
            self._carry_out(command)
        except Cancelled:
            self._give_up(CANCELLED)
        except Exception as error:  # The page must live on: what went wrong is shown.
            offer = (error.label, error.command) if isinstance(error, Unconfirmed) else None
            message = str(error)
            if not isinstance(error, VerefineError):
                _LOG.exception("command %s failed", command)
                message = unforeseen(error)
            self._give_up(message, refused=True, offer=offer, with_maps=not only_shows)

    def _carry_out(self, command: c.Command | object | None) -> None:
        if isinstance(command, c.RefreshGallery):
            self._debugger.apply(command)
            self._page.show_gallery()
        elif isinstance(command, c.Command):
            self._page.leave_off()
            before = self._debugger.run.cursor
            self._apply(command)
            if not (command.latest_wins and self._requests.holds()):  # A newer one is there: its picture will do.
                self.show()
                self._page.animate(command, before)
                self._page.move_camera(command)
        elif self._debugger.is_busy:
            with self._requests.cancellable():
                self._debugger.tick()
            if not self._debugger.is_busy or self._page.age_s > REFRESH_S:
                self.show()
        else:
            with suppress(Cancelled), self._requests.aside():  # Whatever comes next shows all of it again.
                self._page.go_on()
                if self._busy.is_said:  # As that kernels were compiled for the landscape.
                    self._page.show_run()
                    self._busy.shown()

    def _apply(self, command: c.Command) -> None:
        if not isinstance(command, c.OpenFrame | c.OpenDemo | c.OpenSession) or command.hulls:
            with self._requests.cancellable(command.is_long):
                self._debugger.apply(command)
            return
        try:
            with self._requests.cancellable(command.is_long), self._requests.opening():
                self._debugger.apply(command)
        except Cancelled:
            if not self._requests.wants_hulls:
                raise
            self._apply(replace(command, hulls=True))

    def _give_up(
        self,
        message: str,
        refused: bool = False,
        offer: tuple[str, c.Command] | None = None,
        with_maps: bool = True,
    ) -> None:
        """Shows what was open before a command that was not carried out, and says why it was not.

        Without score maps where they, or what comes with them, are what could not be shown: or it would go on for ever.
        """
        self._page.leave_off()
        self._debugger.pause()
        self._debugger.pause_b()
        self._debugger.message, self._debugger.refused, self._debugger.offer = message, refused, offer
        self._page.show(with_picture=True, with_maps=with_maps)
        self._busy.shown()

    def _view_meanwhile(self, command: c.Command) -> None:
        """Carries out what does not disturb what is being done, and goes on saying what that is."""
        try:
            self._debugger.apply(command)
        except VerefineError as error:
            self._debugger.message, self._debugger.refused = str(error), True
        if isinstance(command, c.RefreshGallery):
            return self._page.show_gallery()
        self._page.show(with_picture=True)
        self._page.move_camera(command)
        self._page.go_on()
        self._page.leave_off()
        self._busy.repeat()

    def show(self) -> None:
        """What there is now."""
        self._page.show(with_picture=self._debugger.is_busy)
        self._busy.shown()


def unforeseen(error: Exception) -> str:
    """What the page says of an error that was not foreseen: a bug, unless a refiner of another program raised it."""
    of_refiner = raised_by_refiner(error)
    if not of_refiner:
        return f"{type(error).__name__}: {error} (a bug: please report it with the log)"
    return (
        f"{of_refiner[0].upper()}{of_refiner[1:]}. The run stands before it: mend the refiner, then start the program "
        "again."
    )
