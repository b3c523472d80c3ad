"""Draws the small pictures of the built-in scenes that the page shows in its list, and while such a scene is opened:
``python scripts/draw_demo_pictures.py [SCENE …]``.
"""

from __future__ import annotations

import sys

import numpy as np
from msgspec import structs
from PIL import Image

from verefine_viz.core.settings import Session
from verefine_viz.core.writing import atomic
from verefine_viz.page.web_files import demo_picture
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo import demo_names

WIDTH, HEIGHT, QUALITY = 480, 360, 70
MARGIN = 1.5
"""How much larger than the objects the part of the photo is that is shown."""


def drawn(name: str) -> Image.Image:
    """Return the objects of a built-in scene in its first frame, ``WIDTH`` × ``HEIGHT`` pixels."""
    session = Session()
    tools = Toolbox(structs.replace(session, scene=structs.replace(session.scene, source="demo", demo=name)))
    observation = tools.problem(tools.frames[0]).observation
    assert observation.rgb is not None
    rows, columns = np.nonzero(observation.object_mask)
    w = MARGIN * max(np.ptp(columns), np.ptp(rows) * WIDTH / HEIGHT)
    h = w * HEIGHT / WIDTH
    u, v = (columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2
    box = (round(u - w / 2), round(v - h / 2), round(u + w / 2), round(v + h / 2))
    return Image.fromarray(observation.rgb).crop(box).resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    for name in sys.argv[1:] or demo_names():
        file = demo_picture(name)
        file.parent.mkdir(exist_ok=True)
        with atomic(file) as part:
            drawn(name).save(part, format="WEBP", quality=QUALITY, method=6)
        print(f"{file.name}: {file.stat().st_size} bytes")
