"""What the page says while something takes long: what it is, how much is done, how to cancel it."""

from __future__ import annotations

from time import monotonic

from verefine_viz.physics.decomposition import PARTS_OF
from verefine_viz.run.kernel_compilation import COMPILING
from verefine_viz.viewer.commands import UseHulls
from verefine_viz.viewer.debugger import RequestQueue
from verefine_viz.viewer.drawing.markup import block, text
from verefine_viz.viewer.panels.run_panel import USE_HULLS, RunPanel
from verefine_viz.viewer.web.server import Server

LOADING = "Loading the program."
BETWEEN_S = 0.12
"""Time between two words on how much is done [s]."""


class BusyStatus:
    """Says it where the panels will be, and in the Run panel once it is there.

    Args:
        server: of the page.
        requests: know whether what is being done can be cancelled.
    """

    def __init__(self, server: Server, requests: RequestQueue) -> None:
        self._server, self._requests = server, requests
        self._loading = server.gui.add_html(block(opening(LOADING)))
        self._hulls = server.gui.add_button(USE_HULLS, visible=False)
        self._hulls.on_click(lambda _: requests.send(UseHulls()))
        self._panel: RunPanel | None = None
        self._doing = ""
        """What is being done; "" = it is shown."""
        self._share: float | None = None
        """How much of it is done [0 to 1]; None = it is unknown."""
        self._told_at = 0.0
        self.has_compiled = False
        """Whether kernels were not there yet."""
        self.is_said = False
        """Whether it stands where the panel's own words belong."""

    def tell(self, doing: str, share: float | None = None) -> None:
        """Before something that may take seconds, and on the way; see :class:`core.progress.ProgressToken`."""
        if not doing and monotonic() - self._told_at < BETWEEN_S:
            return
        self._doing, self._share, self._told_at = doing or self._doing, share, monotonic()
        self.repeat()

    def repeat(self) -> None:
        """Something else was shown in between."""
        self.say(self._doing, self._share, self._requests.can_cancel)

    def cancelling(self) -> None:
        """What is being done was cancelled: it may take a moment until it ends."""
        if self._panel is not None and self._doing:
            self.say(f"Cancelling. This has to end first: {self._doing}")

    def compiling(self) -> None:
        """Why it takes longer than usual."""
        self.has_compiled = True
        self.say(f"{self._doing} {COMPILING}".lstrip())

    def shown(self) -> None:
        """What was being done is shown."""
        self._doing, self.is_said = "", False

    def move_to(self, panel: RunPanel) -> None:
        """The panels are there."""
        self._panel = panel

    def clear(self) -> None:
        """Makes room for the panels."""
        self._loading.remove()
        self._hulls.remove()

    def fail(self, why: str) -> None:
        """The session cannot be opened."""
        self._loading.content = block(f'<p class="bad">{text(why)}</p>')

    def say(self, doing: str, share: float | None = None, can_cancel: bool = False) -> None:
        """Shows it at once."""
        offers_hulls = self._requests.offers_hulls and PARTS_OF in doing
        if self._panel is None:
            self._loading.content = block(opening(doing))
            self._hulls.visible = offers_hulls
        else:
            self.is_said = True
            self._panel.tell(doing, share, can_cancel, offers_hulls)
        self._server.flush()


def opening(doing: str) -> str:
    """What the page says until the session is open."""
    end = '<p class="dim">Ctrl-C where the program was started ends it.</p>'
    return f'<div style="padding:0 12px"><h3>Opening the session</h3><p>{text(doing)}</p>{end}</div>'
