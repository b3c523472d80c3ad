"""Which view answers which want: functions ``(space, want, blobs) -> dict``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from verefine_viz.page import protocol as p
from verefine_viz.page.views.comparison import comparison
from verefine_viz.page.views.crops import crops
from verefine_viz.page.views.object_track import track
from verefine_viz.page.views.physics import physics
from verefine_viz.page.views.pixel_maps import maps
from verefine_viz.page.views.pose_outlines import outlines
from verefine_viz.page.views.recorded_poses import recorded
from verefine_viz.page.views.score_landscape import landscape
from verefine_viz.page.views.shaded_model import shaded

ANSWERS: dict[type, Callable[..., dict[str, Any]]] = {
    p.ComparisonWanted: comparison,
    p.LandscapeWanted: landscape,
    p.MapsWanted: maps,
    p.OutlinesWanted: outlines,
    p.PhysicsWanted: physics,
    p.ShadedWanted: shaded,
    p.CropsWanted: crops,
    p.TrackWanted: track,
    p.RecordedWanted: recorded,
}
