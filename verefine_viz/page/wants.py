"""Which view answers which want: functions ``(space, want, blobs) -> dict``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from verefine_viz.page import protocol as p
from verefine_viz.page.views.comparison import comparison
from verefine_viz.page.views.crops import crops
from verefine_viz.page.views.object_track import track
from verefine_viz.page.views.physics import physics
from verefine_viz.page.views.score_landscape import landscape

ANSWERS: dict[type, Callable[..., dict[str, Any]]] = {
    p.Comparison: comparison,
    p.Landscape: landscape,
    p.Physics: physics,
    p.Crops: crops,
    p.Track: track,
}
