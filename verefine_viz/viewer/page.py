"""What the page shows of a debugger, what a person needs first at once and the rest when nothing else waits."""

from __future__ import annotations

from collections.abc import Iterator
from time import monotonic

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.gallery import Gallery
from verefine_viz.viewer.layout import Layout
from verefine_viz.viewer.requests import Requests
from verefine_viz.viewer.scene_view import SceneView
from verefine_viz.viewer.server import Server
from verefine_viz.viewer.side_nodes import SideNodes
from verefine_viz.viewer.view import View
from verefine_viz.viewer.viewing import later, standing

FRAME_S = 1 / 25
"""Time between two pictures of an animation [s]."""
_END = object()


class Page:
    """3D scene and panels of one session.

    Args:
        server: where they are shown.
        debugger: whose view they show.
        requests: takes what a person asks for.
        batch: whose answers are listed; None = no batch.
    """

    def __init__(self, server: Server, debugger: Debugger, requests: Requests, batch: Gallery | None) -> None:
        self._server, self._debugger, self._requests = server, debugger, requests
        self.scene = SceneView(server, requests.send)
        self.sides = SideNodes(server)
        self.layout = Layout(server, requests.send, batch)
        self.layout.on_link(requests.send)
        self._shown_at = 0.0
        self._is_shallow = False
        self._animation: Iterator[None] | None = None
        self._later: Iterator[None] | None = None

    @property
    def age_s(self) -> float:
        """How long ago it was drawn [s]."""
        return monotonic() - self._shown_at

    @property
    def wait_s(self) -> float | None:
        """How long it is complete without :meth:`go_on` [s]; None = until something is asked for."""
        if self._is_shallow:
            return 0
        if self._animation is not None:
            return FRAME_S
        return None if self._later is None else 0

    def show(self) -> None:
        """Poses, numbers and words at once; what takes longer is left to :meth:`go_on`."""
        self._view = self._debugger.view(deep=False)
        hand_is_ahead = self._requests.holds(c.Seek)
        with self._server.atomic():
            self.scene.show(self._view)
            self.sides.show(self._view)
            self.layout.show(self._view, hand_is_ahead)
        self._server.flush()
        self._shown_at = monotonic()
        self._is_shallow = True

    def animate(self, command: c.Command, before: int) -> None:
        """Has what a command did shown picture by picture, where it is to be; ``before`` was the cursor before it."""
        view = self._view
        stepped = isinstance(command, c.Step) and view.cursor == before + 1
        if stepped and view.look.animate and view.is_current:
            self._animation = self.scene.animation(view)
        elif isinstance(command, c.PlayPath):
            self._animation = self.scene.path_animation(view)

    def go_on(self) -> None:
        """One thing more: score maps, the next picture, or something about the whole scene's physics."""
        if self._is_shallow:
            self._show_deep()
        elif self._animation is not None:
            if next(self._animation, _END) is _END:
                self._animation = None
        elif self._later is not None and next(self._later, _END) is _END:
            self._later = None
            self._show_physics()

    def leave_off(self) -> None:
        """Something else is to be shown: what is left of animation and physics is of no use."""
        self._animation = self._later = None

    def _show_deep(self) -> None:
        self._is_shallow = False
        view = self._debugger.view()
        with self._server.atomic():
            self.scene.show_deep(view)
            self.layout.show_deep(view)
        self._server.flush()
        if not view.physics.complete or _judged_alone(view):
            self._later = later(view, self._debugger.workspace.branch.judge)

    def _show_physics(self) -> None:
        """What was worked out about the whole scene."""
        view = self._debugger.view()
        with self._server.atomic():
            self.scene.show_physics(view)
            self.layout.show_physics(view)
        self._server.flush()


def _judged_alone(view: View) -> bool:
    """Whether the plausibility of the poses in focus is still to be worked out."""
    missing = any(name not in view.plausible for name in standing(view.poses))
    return missing and view.target.observation.support is not None
