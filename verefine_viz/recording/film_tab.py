"""The key moments of each answer: a picture with its title and colours, and its caption as text."""

from __future__ import annotations

import io
from collections.abc import Mapping

import rerun as rr
import rerun.blueprint as rrb

from verefine_viz.pictures.film import Film, columns_of
from verefine_viz.recording import entities
from verefine_viz.recording.recording_file import RecordingFile

JPEG_QUALITY = 88


def log_film(file: RecordingFile, branch_name: str, film: Film) -> None:
    """Log the moments of one object's answer as static data, to be seen side by side."""
    for k, (moment, panel) in enumerate(zip(film.moments, film.panels(), strict=True)):
        out = io.BytesIO()
        # One-pixel lines and text keep their colours only without chroma subsampling.
        panel.save(out, format="JPEG", quality=JPEG_QUALITY, subsampling=0)
        picture = rr.EncodedImage(contents=out.getvalue(), media_type="image/jpeg")
        file.log(entities.moment(branch_name, k), picture, rr.AnyValues(title=moment.title, caption=moment.caption))


def film_tab(n_moments: Mapping[str, int]) -> rrb.Container:
    """A tab of the whole window: for each object its moments, in their order.

    Args:
        n_moments: how many there are, by the name of the object's branch.
    """
    return rrb.Tabs(*(_moments(name, n) for name, n in n_moments.items()), name="Film")


def _moments(branch_name: str, n: int) -> rrb.Grid:
    views = (rrb.Spatial2DView(origin=entities.moment(branch_name, k), name=f"{k + 1}") for k in range(n))
    return rrb.Grid(*views, grid_columns=columns_of(n), name=branch_name)
