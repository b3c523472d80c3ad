"""Where the panels are: Run and the tabs on the right, maps, curves and timeline below, the legend on the left."""

from __future__ import annotations

import logging
from collections.abc import Callable

import viser

from verefine_viz.core.errors import InputError
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.command_json import from_json
from verefine_viz.viewer.panels.bandit_panel import BanditPanel, CurvesPanel
from verefine_viz.viewer.panels.batch_panel import BatchPanel
from verefine_viz.viewer.panels.compare_panel import ComparePanel
from verefine_viz.viewer.panels.errors_panel import ErrorsPanel, ScoreErrorPanel
from verefine_viz.viewer.panels.landscape_panel import LandscapePanel
from verefine_viz.viewer.panels.objects_panel import ObjectsPanel, height_px
from verefine_viz.viewer.panels.order_panel import OrderPanel
from verefine_viz.viewer.panels.physics_panel import PhysicsPanel
from verefine_viz.viewer.panels.run_panel import RunPanel
from verefine_viz.viewer.panels.score_panel import MapsPanel, ScorePanel
from verefine_viz.viewer.panels.session_panel import SessionPanel
from verefine_viz.viewer.panels.settings_panel import SettingsPanel
from verefine_viz.viewer.panels.timeline_panel import TimelinePanel
from verefine_viz.viewer.panels.view_panels import BreakpointsPanel, ViewPanel
from verefine_viz.viewer.panels.widgets import Send, add_style, asked_by, by_user
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.batch_gallery import Gallery
from verefine_viz.viewer.web.viser_internals import LINK_LABEL, NARROW_TABS, hidden, small_window

_LOG = logging.getLogger(__name__)
RIGHT_PX = 372
GAP_PX = 6
TIMELINE_PX = 154
STRIP_PX = 244
MAPS_PX = 592
CURVES_PX = 296
VIEW_PX = 254
OBJECTS_PX = 326
UPPER_PX = 378

KEYS: tuple[tuple[str, str | None, c.Command], ...] = (
    ("Run / pause", "space", c.TogglePause()),
    ("Step one iteration", "N", c.Step()),
    ("Step one stage", "M", c.StepStage()),
    ("Back one iteration", "B", c.Back()),
    ("First", "home", c.Seek(0)),
    ("Last iteration made", "end", c.SeekEnd()),
    ("Previous event", "pageup", c.SeekEvent(-1)),
    ("Next event", "pagedown", c.SeekEvent(1)),
    ("Batch: next failure", "J", c.OpenFailure(1)),
    ("Batch: previous failure", "K", c.OpenFailure(-1)),
    ("Ground truth on / off", "G", c.ShowLayer("ground truth")),
    ("Colour of the cloud", "C", c.ColorCloud()),
    ("Hypotheses on / off", "H", c.ShowLayer("hypotheses")),
    ("Play the simulated path", "P", c.PlayPath()),
    ("A/B: first difference", "F", c.SeekDifference()),
    ("A/B: swap", "X", c.SwapSides()),
    ("A/B: B on / off", "T", c.ShowSide("B")),
    ("Run to the next event", None, c.RunUntil("event")),
    ("Run to the next breakpoint", None, c.RunUntil("breakpoint")),
    ("Pause", None, c.Pause()),
    ("Cancel what is being done", "escape", c.Cancel()),
    ("Restart", None, c.Restart()),
    ("Score the ground truth", None, c.ScoreGroundTruth()),
    ("Edit the pose", None, c.EditPose()),
    ("Continue from the edited pose", None, c.ForkFromPose()),
    ("Fork here", None, c.Fork()),
    ("Animate steps", None, c.Animate(True)),
    ("Do not animate steps", None, c.Animate(False)),
    ("Export the recording", None, c.Export("recording")),
    ("Export the 3D scene as HTML", None, c.Export("scene")),
    ("Export the results CSV", None, c.Export("results")),
    ("Export the score maps as PNG", None, c.Export("maps")),
)
"""Label in the palette (Ctrl+K), hotkey, command. W A S D Q E and the arrows move the camera, V takes it back."""


def set_theme(gui: viser.GuiApi) -> None:
    """Dark, without what is not ours."""
    gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
    gui.set_panel_label("verefine-viz")


class Layout:
    """All panels, placed. One per server; every browser shows the same."""

    def __init__(
        self,
        server: viser.ViserServer,
        send: Send,
        reset_camera: Callable[[viser.ClientHandle], None],
        batch: Gallery | None = None,
    ) -> None:
        gui = server.gui
        set_theme(gui)
        gui.add_html(small_window(RIGHT_PX))
        self.run = RunPanel(gui, send)
        self.link = gui.add_text(LINK_LABEL, "")
        # One tab more with a batch, and still one row of them.
        add_style(gui, hidden(self.link), NARROW_TABS if batch is not None else "")
        main = gui.main_panel
        main.dock_right()
        main.set_width(RIGHT_PX)
        tabs = gui.add_panel()
        self.batch: BatchPanel | None = None
        if batch is not None:
            with tabs.add_tab("Batch"):
                self.batch = BatchPanel(gui, batch)
        with tabs.add_tab("Score"):
            self.score = ScorePanel(gui, send)
        with tabs.add_tab("Bandit"):
            self.bandit = BanditPanel(gui)
        with tabs.add_tab("Physics"):
            self.physics = PhysicsPanel(gui, send)
        with tabs.add_tab("Landscape"):
            self.landscape = LandscapePanel(gui)
        with tabs.add_tab("Errors"):
            self.errors = ErrorsPanel(gui, send)
        with tabs.add_tab("Order"):
            self.order = OrderPanel(gui)
        with tabs.add_tab("A/B"):
            self.compare = ComparePanel(gui, send)
        with tabs.add_tab("Session"):
            self.session = SessionPanel(gui, send, lambda: self.settings.waiting)
        tabs.dock_below(main)
        timeline = gui.add_panel()
        with timeline.add_tab("Timeline"):
            self.timeline = TimelinePanel(gui, send)
        timeline.float(x=GAP_PX, y=-GAP_PX, width=MAPS_PX + GAP_PX + CURVES_PX, height=TIMELINE_PX)
        maps = gui.add_panel()
        with maps.add_tab("Score maps"):
            self.maps = MapsPanel(gui)
        above = -(TIMELINE_PX + 2 * GAP_PX)
        maps.float(x=GAP_PX, y=above, width=MAPS_PX, height=STRIP_PX)
        curves = gui.add_panel()
        self.curves = CurvesPanel(gui, curves)
        self.score_error: ScoreErrorPanel | None = None
        if batch is not None:
            with curves.add_tab("Score/error"):
                self.score_error = ScoreErrorPanel(gui)
        curves.float(x=MAPS_PX + 2 * GAP_PX, y=above, width=CURVES_PX, height=STRIP_PX)
        layers = gui.add_panel()
        with layers.add_tab("View"):
            self.layers = ViewPanel(gui, send)
        with layers.add_tab("Settings"):
            self.settings = SettingsPanel(gui, send)
        with layers.add_tab("Breakpoints"):
            self.breakpoints = BreakpointsPanel(gui, send)
        layers.float(x=GAP_PX, y=GAP_PX, width=VIEW_PX, height=UPPER_PX)
        self._objects_panel = gui.add_panel(visible=False)
        with self._objects_panel.add_tab("Objects"):
            self.objects = ObjectsPanel(gui)
        self._n_objects = 0
        self.commands = [gui.add_command(label, hotkey=key) for label, key, _ in KEYS]  # type: ignore[arg-type]
        for handle, (_, _, command) in zip(self.commands, KEYS, strict=True):
            handle.on_trigger(lambda event, command=command: send(asked_by(event.client_id, command)))
        self.reset_view = gui.add_command("Reset the view", hotkey="V")

        @self.reset_view.on_trigger
        def reset(event: viser.CommandEvent) -> None:
            if event.client is not None:
                reset_camera(event.client)

    def on_link(self, handler: Send) -> None:
        """Calls ``handler`` with the command of every link that is clicked."""

        def received(value: str) -> None:
            line, _, _ = value.rpartition(" ")
            try:
                handler(from_json(line))
            except InputError as error:
                _LOG.warning("a link was refused: %s", error)

        self.link.on_update(by_user(received))

    def show(self, snapshot: Snapshot, slider_is_ahead: bool = False) -> None:
        """All panels, each on its own."""
        self.run.show(snapshot)
        self.settings.show(snapshot)
        self.breakpoints.show(snapshot)
        self._show_objects(snapshot)
        self.timeline.show(snapshot, slider_is_ahead)
        self.score.show(snapshot)
        self.bandit.show(snapshot)
        self.physics.show(snapshot)
        self.errors.show(snapshot)
        self.landscape.show(snapshot)
        self.compare.show(snapshot)
        self.order.show(snapshot)
        self.session.show(snapshot)
        self.layers.show(snapshot)
        if self.batch is not None and self.score_error is not None:
            self.batch.show(snapshot)
            self.score_error.show(snapshot)
        self.curves.show(snapshot)
        self.maps.show(snapshot)

    def show_deep(self, snapshot: Snapshot) -> None:
        """The panels about score maps and plausibility, and the one that may have shown what takes long."""
        self.run.show(snapshot)
        self.maps.show(snapshot)
        self.score.show(snapshot)
        self.physics.show(snapshot)

    def show_physics(self, snapshot: Snapshot) -> None:
        """The panels about physics of the whole scene, and the one that may have shown what takes long."""
        self.run.show(snapshot)
        self._show_objects(snapshot)
        self.physics.show(snapshot)
        self.landscape.show(snapshot)

    def _show_objects(self, snapshot: Snapshot) -> None:
        """The list of objects, where there are several; placed again for a frame with more or fewer of them."""
        n = len(snapshot.scene.objects)
        if n != self._n_objects:
            self._n_objects = n
            self._objects_panel.visible = n > 1
            self._objects_panel.float(x=-GAP_PX, y=GAP_PX, width=OBJECTS_PX, height=height_px(n))
        if n > 1:
            self.objects.show(snapshot)
