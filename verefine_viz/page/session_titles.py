"""Session files by their titles."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from verefine_viz.core.errors import VerefineError
from verefine_viz.core.files import read_file
from verefine_viz.page.frame_messages import TitledSession
from verefine_viz.run.session_file import LARGEST_BYTES


def titled(files: Sequence[Path]) -> list[TitledSession]:
    """Name session files by their titles; one without a title by its scene and a number, which gives nothing away."""
    out: list[TitledSession] = []
    for number, path in enumerate(files, 1):
        title, scene, demo = _title_and_scene(path, path.stat().st_mtime_ns if path.exists() else 0)
        out.append(TitledSession(str(path), title or f"{scene} {number}", demo))
    return out


@lru_cache(maxsize=256)
def _title_and_scene(path: Path, changed_ns: int) -> tuple[str, str, str]:
    try:
        content: dict[str, Any] = tomllib.loads(read_file(path, most_bytes=LARGEST_BYTES).decode())
    except (VerefineError, ValueError):
        return path.stem, "", ""
    scene = content.get("scene")
    known = scene if isinstance(scene, dict) else {}
    demo = str(known.get("demo") or "")
    return str(content.get("title") or ""), demo or Path(str(known.get("dataset", "session"))).name, demo
