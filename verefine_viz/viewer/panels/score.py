"""The Score panel: why one pose scores higher than another."""

from __future__ import annotations

from math import acos, degrees

import viser

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.look import STAGES
from verefine_viz.viewer.maps import LABELS, MAP_NAMES
from verefine_viz.viewer.markup import hinted, text
from verefine_viz.viewer.pair_words import compared
from verefine_viz.viewer.scene_tables import passes_table
from verefine_viz.viewer.scene_words import TERMS, scene_sentence
from verefine_viz.viewer.score_tables import probe_table, score_table
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Block, Send, by_person, compact

ROW_PX = 26
"""So that both stages in numbers fit into the panel."""


class ScorePanel:
    """Two stages in numbers, and one pixel of both."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui)
        self.a = gui.add_dropdown("A", STAGES, initial_value="simulated", hint="first stage to compare")
        self.b = gui.add_dropdown("B", STAGES, initial_value="refined", hint="second stage to compare")
        self.a.on_update(by_person(lambda v: send(c.Compare(a=v))))
        self.b.on_update(by_person(lambda v: send(c.Compare(b=v))))
        self._probe = Block(gui)
        self._numbers = Block(gui)
        labels = {LABELS[m][0]: m for m in MAP_NAMES}
        self.map = gui.add_dropdown("On image", tuple(labels), hint="the map of B that lies on the camera image in 3D")
        self.map.on_update(by_person(lambda v: send(c.ShowMap(labels[v]))))
        rows = "".join(compact(row, ROW_PX) for row in (self.a, self.b, self.map))
        gui.add_html(f"<style>{rows}</style>")

    def show(self, view: View) -> None:
        """Numbers of both stages and of the probed pixel."""
        self.a.visible = self.b.visible = not view.is_whole_scene
        self.a.value, self.b.value = view.look.a, view.look.b
        self.map.value = LABELS[view.look.map][0]
        if view.is_whole_scene and not view.deep:
            return  # A scene is scored when there is time to draw it.
        self._words.show(hinted(scene_sentence(view) if view.is_whole_scene else compared(view), TERMS))
        a, b = (side.pose if side else None for side in (view.a, view.b))
        s = view.session.score
        cut = f"τ = {s.tau_m * 1000:g} mm, normals count up to {degrees(acos(1 - s.alpha)):.0f}°, pixels: {s.pixels}"
        probed = view.look.pixel is not None
        # With a pixel's numbers above it the table leaves out what its bars say, so that both fit the screen.
        below = "" if probed else f'<p class="dim">{text(cut)}</p>{_HINT}'
        passes = passes_table(view) if view.is_whole_scene else ""
        self._numbers.show(score_table([a, b], short=probed) + passes + below)
        if not view.deep:
            return
        sides = [(side.pose.label, side.probe) if side else ("", None) for side in (view.a, view.b)]
        self._probe.show(probe_table(sides[0], sides[1]))


_HINT = "<p class='dim'>Click a map, photo or cloud for a pixel in numbers.</p>"
