"""Tells a folder of kept frames in which no frame is whole yet, by its session file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from verefine_viz.core.errors import InputError

HEAD = "# Frames kept by keep_frame. This file is written anew with every frame: copy it before you change it.\n"
"""How the session file of such a folder begins; until the first frame is nearly whole it holds nothing else."""
SCENE_ID = 1


def scene_folder(folder: Path) -> Path:
    """Where the frames of a folder are."""
    return folder / "test" / f"{SCENE_ID:06d}"


def check_holds_a_frame(path: Path, text: str, raw: Mapping[str, Any]) -> None:
    """
    Args:
        path: of a session file.
        text: of the file.
        raw: what it says.

    Raises:
        InputError: it is that of a folder in which the first frame was begun and not finished.
    """
    if not text.startswith(HEAD):
        return
    scene = scene_folder(path.parent)
    # The camera is the last file of a frame. A copy of the session elsewhere has no scene beside it.
    if not raw or (scene.is_dir() and not (scene / "scene_camera.json").is_file()):
        raise InputError(
            f"{path.parent} holds no whole frame yet: keep_frame is still writing the first one, or its program was "
            "stopped in the middle; keep a frame there again, which makes it anew, and then open this session"
        )
