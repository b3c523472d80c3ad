"""Which view answers which want: functions ``(space, want, blobs) -> answer``, handed what draws for them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from verefine_viz.calibration.edges import depth_edges
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import AnyAnswer
from verefine_viz.page.views.comparison import comparison
from verefine_viz.page.views.crops import crops
from verefine_viz.page.views.doubt_picture import doubt
from verefine_viz.page.views.film_moments import film
from verefine_viz.page.views.physics import physics
from verefine_viz.page.views.pixel_maps import maps
from verefine_viz.page.views.pixel_point import point
from verefine_viz.page.views.pose_outlines import outlines
from verefine_viz.page.views.recorded_poses import recorded
from verefine_viz.page.views.refined_here import refined_here
from verefine_viz.page.views.score_landscape import landscape
from verefine_viz.page.views.sequence import sequence
from verefine_viz.page.views.shaded_model import shaded
from verefine_viz.pictures.film import film_pictures
from verefine_viz.pictures.shaded_models import shaded_picture
from verefine_viz.pictures.silhouettes import outline
from verefine_viz.pictures.surface_distances import point_distance
from verefine_viz.run.refined_pose import refined_pose

ANSWERS: dict[type, Callable[..., AnyAnswer]] = {
    p.ComparisonWanted: comparison,
    p.LandscapeWanted: landscape,
    p.MapsWanted: maps,
    p.OutlinesWanted: partial(outlines, outline_of=outline),
    p.PhysicsWanted: physics,
    p.PointWanted: partial(point, distance_of=point_distance),
    p.RefinedWanted: partial(refined_here, refined_of=refined_pose),
    p.DoubtWanted: partial(doubt, outline_of=outline, edges_of=depth_edges),
    p.ShadedWanted: partial(shaded, picture_of=shaded_picture),
    p.CropsWanted: crops,
    p.SequenceWanted: sequence,
    p.RecordedWanted: recorded,
    p.FilmWanted: partial(film, pictures_of=film_pictures),
}
