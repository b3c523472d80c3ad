"""The panel inside the 3D view, of viser's own widgets: layers, cloud colours, camera, clipping, gizmo."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, cast, get_args

import numpy as np
import viser
from PIL import Image as PilImage
from PIL import ImageDraw

from verefine_viz.core.palette import EMPTY, Image, Scale

CloudColors = Literal["photo", "distance to model", "normals", "class"]
_CLOUDS: tuple[CloudColors, ...] = get_args(CloudColors)
CameraPlace = Literal["sensor", "object", "first"]
_PLACES: dict[str, CameraPlace] = {"Sensor": "sensor", "Object": "object", "First": "first"}
LAYERS = {
    "cloud": True,
    "photo": True,
    "plane": True,
    "gravity": True,
    "other objects": True,
    "stages": True,
    "initial": False,
    "best": False,
    "runner-up": True,
    "ground truth": True,
    "hypotheses": False,
    "own colours": True,
    "contacts": True,
    "overlaps": True,
}
"""What can be shown, and whether it is at first."""
_BAR_PX = (220, 34)
_WIDTH_PX = 236
WHOLE_SCENE = 4.0
"""Box sizes from this one on leave everything in [diameters]."""


class ScenePanel:
    """Holds the widgets, which all windows share.

    Args:
        server: where they are.
        changed: called after the user changed one.
        to_place: called with the browser whose camera is to be taken somewhere.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        changed: Callable[[], None],
        to_place: Callable[[viser.ClientHandle, CameraPlace], None],
    ) -> None:
        gui = server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_width="small")
        gui.set_panel_label("View")
        gui.main_panel.float(x=-6, y=6, width=_WIDTH_PX)
        gui.main_panel.minimize()
        places = gui.add_button_group("Camera", tuple(_PLACES))
        self._cloud = gui.add_dropdown("Cloud", _CLOUDS, initial_value="photo", hint="Colours of the observed points")
        self._bar = gui.add_image(np.zeros((_BAR_PX[1], _BAR_PX[0], 3), np.uint8), format="png", visible=False)
        self._scale: Scale | None = None
        self._box = gui.add_slider(
            "Box", 0.6, WHOLE_SCENE, 0.1, WHOLE_SCENE, hint="Show only what lies in a box around the object in focus"
        )
        self._cut = gui.add_slider("Cut", 0, 100, 1, 0, hint="Cut the object in focus open from the front [%]")
        self._gizmo = gui.add_slider("Gizmo", 80, 320, 10, 170, hint="Size of the handles of an edited pose [px]")
        with gui.add_folder("Layers"):
            self._layers = {name: gui.add_checkbox(name, on) for name, on in LAYERS.items()}
        for widget in (self._cloud, self._box, self._cut, self._gizmo, *self._layers.values()):
            cast(Any, widget).on_update(lambda _: changed())

        @places.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
            if event.client is not None:
                to_place(event.client, _PLACES[event.target.value])

    @property
    def cloud(self) -> CloudColors:
        """What the observed points are coloured by."""
        return self._cloud.value

    @property
    def layers(self) -> frozenset[str]:
        """What is shown."""
        return frozenset(name for name, box in self._layers.items() if box.value)

    def hide(self, layer: str) -> None:
        """Take a layer from the view, as if the user had."""
        self._layers[layer].value = False

    @property
    def box(self) -> float | None:
        """Side of the box around the object in focus [its diameter]; None = everything is shown."""
        return None if self._box.value >= WHOLE_SCENE else float(self._box.value)

    @property
    def cut(self) -> float:
        """How much of the object in focus is cut away, 0 to 1."""
        return self._cut.value / 100

    @property
    def gizmo_px(self) -> float:
        return float(self._gizmo.value)

    def show_scale(self, scale: Scale | None) -> None:
        """Draw the colour bar of the cloud, or none."""
        self._bar.visible = scale is not None
        if scale is not None and scale != self._scale:
            self._bar.image, self._scale = signed_bar(scale), scale


def signed_bar(scale: Scale) -> Image:
    """Draw the colour bar of a signed distance to a surface, with its numbers."""
    width, height = _BAR_PX
    bar = PilImage.new("RGB", _BAR_PX, EMPTY)
    row = scale.colors(np.linspace(scale.low, scale.high, width))
    bar.paste(PilImage.fromarray(np.repeat(row[None], 14, axis=0)), (0, 0))
    draw = ImageDraw.Draw(bar)
    for x, text, anchor in (
        (2, f"{scale.low:g} inside", "ls"),
        (width // 2, "0", "ms"),
        (width - 2, f"outside {scale.high:g} {scale.unit}", "rs"),
    ):
        draw.text((x, height - 6), text, fill=(225, 228, 232), anchor=anchor)
    return np.asarray(bar)
