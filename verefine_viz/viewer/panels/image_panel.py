"""The photo of the frame."""

from __future__ import annotations

from io import BytesIO

import viser
from PIL import Image

from verefine_viz.viewer.drawing.score_maps import data_uri
from verefine_viz.viewer.panels.widgets import Block, Send
from verefine_viz.viewer.snapshot.snapshot import Snapshot


class ImagePanel:
    """The photo as large as its pane."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._block = Block(gui, "image-pane")
        self._shown: object = None

    def show(self, snapshot: Snapshot) -> None:
        """The photo, sent once per frame."""
        observation = snapshot.problem.observation
        if observation is self._shown:
            return
        self._shown = observation
        if observation.rgb is None:
            self._block.show('<p class="dim">No photo.</p>')
            return
        out = BytesIO()
        Image.fromarray(observation.rgb).save(out, format="PNG", compress_level=1)
        self._block.show(f'<img src="{data_uri(out.getvalue())}" alt="photo" style="height:100%;object-fit:contain">')
