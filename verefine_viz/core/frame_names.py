"""Names of frames, "scene/image", as sessions, records and files write them."""

from __future__ import annotations

from verefine_viz.core.errors import SettingsError, quoted
from verefine_viz.core.files import id_of

FrameIds = tuple[int, int]
"""(scene, image)."""


def parse_frame(frame: str) -> FrameIds:
    """(scene, image) of ``"50/1"``.

    Raises:
        SettingsError: it is not two numbers with a slash between.
    """
    scene, slash, image = frame.strip().partition("/")
    scene_id, im_id = id_of(scene), id_of(image)
    if not slash or scene_id is None or im_id is None:
        raise SettingsError(f'frame {quoted(frame)} is not "scene/image", such as "50/1"')
    return scene_id, im_id


def frame_name(ids: FrameIds) -> str:
    """``"50/1"`` of (50, 1)."""
    return f"{ids[0]}/{ids[1]}"
