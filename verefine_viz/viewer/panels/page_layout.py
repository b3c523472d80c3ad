"""What the page consists of; where each part is, `assets/layout.css` says from the size of the window."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable

import viser

from verefine_viz.core.errors import InputError
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.assets import asset
from verefine_viz.viewer.command_json import from_json
from verefine_viz.viewer.drawing.markup import carries, double_click, text
from verefine_viz.viewer.grasp_commands import TryGrasp
from verefine_viz.viewer.panels.bandit_panel import BanditPanel, CurvesPanel
from verefine_viz.viewer.panels.compare_panel import ComparePanel
from verefine_viz.viewer.panels.errors_panel import ErrorsPanel, ScoreErrorPanel
from verefine_viz.viewer.panels.gallery_panel import GalleryPanel
from verefine_viz.viewer.panels.grasp_panel import GraspPanel
from verefine_viz.viewer.panels.image_panel import ImagePanel
from verefine_viz.viewer.panels.landscape_panel import LandscapePanel
from verefine_viz.viewer.panels.objects_panel import ObjectsPanel
from verefine_viz.viewer.panels.order_panel import OrderPanel
from verefine_viz.viewer.panels.physics_panel import PhysicsPanel
from verefine_viz.viewer.panels.run_panel import RunPanel
from verefine_viz.viewer.panels.score_panel import MapsPanel, ScorePanel
from verefine_viz.viewer.panels.session_panel import SessionPanel
from verefine_viz.viewer.panels.settings_panel import SettingsPanel
from verefine_viz.viewer.panels.timeline_panel import TimelinePanel
from verefine_viz.viewer.panels.verdict_panel import VerdictPanel
from verefine_viz.viewer.panels.view_panels import BreakpointsPanel, ViewPanel
from verefine_viz.viewer.panels.widgets import Block, Send, add_style, asked_by
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.batch_gallery import Gallery
from verefine_viz.viewer.state.view_options import ViewOptions
from verefine_viz.viewer.text.empty_tabs import empty_tabs
from verefine_viz.viewer.web.viser_internals import LINK_LABEL, hidden, small_window

_LOG = logging.getLogger(__name__)
PANE_PX = 200
"""Width and height of a pane without a style sheet; `assets/layout.css` gives it its own."""
PRESETS: dict[c.Preset, str] = {
    "inspect": "image and 3D view, score maps below",
    "maps": "large score maps; a line to drag parts A from B, the wheel enlarges all of them",
    "compare": "image, 3D view and curves of A and B, score maps below, the A/B tab",
    "gallery": "the answers of the batch that is open (Esc)",
}
"""Name and hint of each layout."""

KEYS: tuple[tuple[str, str | None, c.Command], ...] = (
    ("Run / pause", "space", c.TogglePause()),
    ("Step one iteration", "N", c.Step()),
    ("Step one stage", "M", c.StepStage()),
    ("Back one iteration", "B", c.Back()),
    ("First", "home", c.Seek(0)),
    ("Last iteration made", "end", c.SeekEnd()),
    ("Previous event", "pageup", c.SeekEvent(-1)),
    ("Next event", "pagedown", c.SeekEvent(1)),
    ("Next frame", "L", c.OpenNeighbour(1)),
    ("Previous frame", "O", c.OpenNeighbour(-1)),
    ("Batch: next failure", "J", c.OpenFailure(1)),
    ("Batch: previous failure", "K", c.OpenFailure(-1)),
    ("Ground truth on / off", "G", c.ShowLayer("ground truth")),
    ("Colour of the cloud", "C", c.ColorCloud()),
    ("Ruler from the marked pixel on / off", "R", c.PlaceRuler()),
    ("Hypotheses on / off", "H", c.ShowLayer("hypotheses")),
    ("Play the simulated path", "P", c.PlayPath()),
    ("Grasp the object", None, TryGrasp()),
    ("Look through the camera", None, c.MoveCamera("sensor")),
    ("Focus the object", None, c.MoveCamera("object")),
    ("A/B: first difference", "F", c.SeekDifference()),
    ("A/B: swap", "X", c.SwapSides()),
    ("A/B: B on / off", "T", c.ShowSide("B")),
    ("Enlarge the image, the 3D view, or neither", "Z", c.Enlarge()),
    ("Layout: Inspect", None, c.ShowLayout("inspect")),
    ("Layout: Maps", None, c.ShowLayout("maps")),
    ("Layout: Compare", None, c.ShowLayout("compare")),
    ("Layout: Gallery of the batch", None, c.ShowLayout("gallery")),
    ("Run to the next event", None, c.RunUntil("event")),
    ("Run to the next breakpoint", None, c.RunUntil("breakpoint")),
    ("Pause", None, c.Pause()),
    ("Cancel what is being done", "escape", c.Cancel()),
    ("Restart", None, c.Restart()),
    ("Compare with ground truth", None, c.ScoreGroundTruth()),
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
        several_objects: bool,
        batch: Gallery | None = None,
    ) -> None:
        gui = server.gui
        set_theme(gui)
        add_style(gui, asset("layout.css"))
        gui.add_html(small_window())
        self.verdict = VerdictPanel(gui)
        self._preset, self._opened, self._empty = Block(gui, "tight"), Block(gui), Block(gui, "tight")
        self.run = RunPanel(gui, send)
        self.link = gui.add_text(LINK_LABEL, "")
        add_style(gui, hidden(self.link))
        main = gui.main_panel
        main.dock_right()
        tabs = gui.add_panel()
        with tabs.add_tab("Score"):
            self.score = ScorePanel(gui, send)
        with tabs.add_tab("Bandit"):
            self.bandit = BanditPanel(gui)
        with tabs.add_tab("Physics"):
            self.physics = PhysicsPanel(gui, send)
        with tabs.add_tab("Grasp"):
            self.grasp = GraspPanel(gui, send)
        with tabs.add_tab("Landscape"):
            self.landscape = LandscapePanel(gui)
        with tabs.add_tab("Errors"):
            self.errors = ErrorsPanel(gui, send)
        with tabs.add_tab("Order"):
            self.order = OrderPanel(gui)
        with tabs.add_tab("A/B"):
            self.compare = ComparePanel(gui, send)
        with tabs.add_tab("View"):
            self.layers = ViewPanel(gui, send)
        with tabs.add_tab("Settings"):
            self.settings = SettingsPanel(gui, send)
        with tabs.add_tab("Breakpoints"):
            self.breakpoints = BreakpointsPanel(gui, send)
        with tabs.add_tab("Session"):
            self.session = SessionPanel(gui, send, lambda: self.settings.waiting)
        tabs.dock_below(main)
        with _pane(gui, "Image"):
            Block(gui, "pane").show(enlarges("image"))
            self.image = ImagePanel(gui)
        with _pane(gui, "3D"):
            Block(gui, "pane scene-pane").show(enlarges("3D"))
        with _pane(gui, "Score maps"):
            self.maps = MapsPanel(gui)
        with _pane(gui, "Timeline"):
            self.timeline = TimelinePanel(gui, send)
        self.gallery: GalleryPanel | None = None
        if batch is not None:
            with _pane(gui, "Gallery"):
                self.gallery = GalleryPanel(gui, batch)
        corner = gui.add_panel()
        if several_objects:
            self._add_objects(gui, corner)
        self.curves = CurvesPanel(gui, corner)
        self.score_error: ScoreErrorPanel | None = None
        if batch is not None:
            with corner.add_tab("Score/error"):
                self.score_error = ScoreErrorPanel(gui)
        if not several_objects:
            self._add_objects(gui, corner)
        corner.float(x=0, y=0, width=PANE_PX, height=PANE_PX)
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

        def received(event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
            if event.client is None:
                return  # The program's own change.
            line, _, _ = event.target.value.rpartition(" ")
            try:
                handler(asked_by(event.client_id, from_json(line)))
            except InputError as error:
                _LOG.warning("a link was refused: %s", error)

        self.link.on_update(received)

    def show(self, snapshot: Snapshot, slider_is_ahead: bool = False) -> None:
        """All panels but the photo's, each on its own."""
        self._preset.show(preset_row(snapshot.options, len(snapshot.scene.objects), snapshot.batch is not None))
        self._empty.show(f'<i hidden data-empty="{text(json.dumps(empty_tabs(snapshot)))}"></i>')
        self._opened.show(opened_tabs(snapshot.options.preset, snapshot.comparison is not None))
        self.verdict.show(snapshot)
        self.run.show(snapshot)
        self.settings.show(snapshot)
        self.breakpoints.show(snapshot)
        self.objects.show(snapshot)
        self.timeline.show(snapshot, slider_is_ahead)
        self.score.show(snapshot)
        self.bandit.show(snapshot)
        self.physics.show(snapshot)
        self.grasp.show(snapshot)
        self.errors.show(snapshot)
        self.landscape.show(snapshot)
        self.compare.show(snapshot)
        self.order.show(snapshot)
        self.session.show(snapshot)
        self.layers.show(snapshot)
        if self.gallery is not None and self.score_error is not None:
            self.gallery.show(snapshot)
            self.score_error.show(snapshot)
        self.curves.show(snapshot)
        self.maps.show(snapshot)

    def show_deep(self, snapshot: Snapshot) -> None:
        """The panels about score maps and plausibility, and the one that may have shown what takes long."""
        self.verdict.show(snapshot)
        self.run.show(snapshot)
        self.maps.show(snapshot)
        self.score.show(snapshot)
        self.physics.show(snapshot)

    def show_physics(self, snapshot: Snapshot) -> None:
        """The panels about physics of the whole scene, and the one that may have shown what takes long."""
        self.verdict.show(snapshot)
        self.run.show(snapshot)
        self.objects.show(snapshot)
        self.physics.show(snapshot)
        self.landscape.show(snapshot)

    def show_gallery(self, snapshot: Snapshot) -> None:
        """The panels about frames that come and go."""
        self.run.show_frames(snapshot)
        if self.gallery is not None and self.score_error is not None:
            self.gallery.show(snapshot)
            self.score_error.show(snapshot)

    def _add_objects(self, gui: viser.GuiApi, panel: viser.PanelHandle) -> None:
        with panel.add_tab("Objects"):
            self.objects = ObjectsPanel(gui)


def _pane(gui: viser.GuiApi, label: str) -> viser.GuiTabHandle:
    """A part of the page; `assets/layout.css` finds it by the class of a block inside, and places it."""
    panel = gui.add_panel()
    tab = panel.add_tab(label)
    panel.float(x=0, y=0, width=PANE_PX, height=PANE_PX)
    return tab


def opened_tabs(preset: c.Preset, compares: bool) -> str:
    """What has `assets/page.js` open the tabs that a layout is about, when it is chosen or a comparison begins."""
    if preset != "compare":
        return '<i class="opens-tab" data-tab="Score"></i>'
    curves = '<i class="opens-tab" data-tab="Score" data-of="corner"></i>' if compares else ""
    return f'<i class="opens-tab" data-tab="A/B"></i>{curves}'


def enlarges(pane: c.Pane) -> str:
    """What `assets/page.js` sends when the head of a pane is clicked twice."""
    return f"<i {double_click(c.Enlarge(pane))}></i>"


def preset_row(options: ViewOptions, n_objects: int, has_batch: bool = False) -> str:
    """A button per layout, the one in use marked; `assets/page_marks.js` has the style sheet go by what it carries, and
    by the number of objects.
    """
    buttons = "".join(
        f'<button class="{"on" if options.preset == name else ""}" {carries(c.ShowLayout(name))} title="{text(hint)}">'
        f"{name.capitalize()}</button>"
        for name, hint in PRESETS.items()
        if name != "gallery" or has_batch
    )
    row = (
        f'<div class="presets" data-preset="{options.preset}" data-enlarged="{options.enlarged or ""}">{buttons}</div>'
    )
    return f"<style>:root{{--objects:{n_objects}}}</style>{row}"
