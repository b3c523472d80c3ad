"""Small pictures of the frames that a session names: what its camera saw."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from PIL import Image as PilImage

from verefine_viz.core.settings import SceneSettings, Session
from verefine_viz.pictures.answer_pictures import camera_image, picture_source, webp
from verefine_viz.scenes.source import SceneSource

WIDTH_PX = 160
"""Width of a picture; 2 to 4 kB each."""


@dataclass(frozen=True)
class FrameOfSession:
    """A frame of the data that a session names."""

    scene: SceneSettings
    frame: str
    session: Session = field(compare=False, repr=False)


class FramePainter:
    """Draws frames, with data sources of its own. Belongs to one thread."""

    def __init__(self) -> None:
        self._source: tuple[SceneSettings, SceneSource] | None = None

    def __call__(self, of: FrameOfSession) -> bytes:
        """Draw a frame, as WebP.

        Raises:
            VerefineError: it cannot be read.
        """
        if self._source is None or self._source[0] != of.scene:
            self._source = of.scene, picture_source(of.session, of.scene.frames)
        whole = PilImage.fromarray(camera_image(self._source[1].problem(of.frame).observation))
        return webp(np.array(whole.resize((WIDTH_PX, round(WIDTH_PX * whole.height / whole.width)))))
