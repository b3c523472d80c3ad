"""What the page shows of a debugger: what the user needs first at once, and the rest when nothing else waits."""

from __future__ import annotations

from collections.abc import Iterator
from time import monotonic
from typing import Literal

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.page_layout import Layout
from verefine_viz.viewer.scene3d.object_nodes import ComparisonNodes
from verefine_viz.viewer.scene3d.scene_view import SceneView, look_again
from verefine_viz.viewer.snapshot.build import deferred_physics, plausibility_stages
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.gallery import Gallery
from verefine_viz.viewer.web.server import Server
from verefine_viz.viewer.worker import RequestQueue

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
        batch: whose answers are listed; None = no batch.
    """

    def __init__(self, server: Server, debugger: Debugger, requests: RequestQueue, batch: Gallery | None) -> None:
        self._server, self._debugger, self._requests = server, debugger, requests
        self.scene = SceneView(server, requests.send)
        self.comparison = ComparisonNodes(server)
        self.layout = Layout(server, requests.send, lambda client: look_again(server, client), batch)
        self.layout.on_link(requests.send)
        self._shown_at = 0.0
        self._snapshot: Snapshot | None = None
        self._left: Literal["maps", "picture"] | None = None
        self._animation: Iterator[None] | None = None
        self._later: Iterator[None] | None = None

    @property
    def age_s(self) -> float:
        """How long ago it was drawn [s]."""
        return monotonic() - self._shown_at

    @property
    def wait_s(self) -> float | None:
        """How long it is complete without :meth:`go_on` [s]; None = until something is asked for."""
        if self._left is not None:
            return FRAME_S if self._left == "picture" else 0
        if self._animation is not None:
            return FRAME_S
        return None if self._later is None else 0

    def show(self, with_picture: bool = False, with_maps: bool = True) -> None:
        """Words and numbers at once; what takes longer is left to :meth:`go_on`.

        Of an object that is shown already score maps come at once too, and the picture is left: a browser without a GPU
        takes its time for that, and would not show anything before.

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
            self.layout.show(self._snapshot, slider_is_ahead)
        self._server.flush()
        self._shown_at = monotonic()

    def animate(self, command: c.Command, before: int) -> None:
        """Has what a command did shown picture by picture, where it is to be; ``before`` was the cursor before it."""
        snapshot = self._snapshot
        assert snapshot is not None
        stepped = isinstance(command, c.Step) and snapshot.cursor == before + 1
        if stepped and snapshot.options.animate and snapshot.is_current:
            self._animation = self.scene.animation(snapshot)
        elif isinstance(command, c.PlayPath):
            self._animation = self.scene.path_animation(snapshot)

    def go_on(self) -> None:
        """One thing more: score maps or the picture, the next one of an animation, or physics of the whole scene."""
        if self._left is not None:
            self._show_left()
        elif self._animation is not None:
            if next(self._animation, _END) is _END:
                self._animation = None
        elif self._later is not None and next(self._later, _END) is _END:
            self._later = None
            self._show_physics()

    def leave_off(self) -> None:
        """Something else is to be shown: what is left of animation and physics is of no use."""
        self._animation = self._later = None

    def _draw(self, snapshot: Snapshot) -> None:
        self.scene.show(snapshot)
        self.comparison.show(snapshot)

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
        self._server.flush()
        if not snapshot.physics.complete or _lacks_plausibility(snapshot):
            self._later = deferred_physics(snapshot, self._debugger.workspace.branch.evaluator)

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


def _lacks_plausibility(snapshot: Snapshot) -> bool:
    """Whether the plausibility of the poses in focus is still to be worked out."""
    missing = any(name not in snapshot.plausible for name in plausibility_stages(snapshot.poses))
    return missing and snapshot.target.observation.support is not None
