"""Film of an object as a file: a strip of its key moments (PNG), or one after the other (GIF)."""

from __future__ import annotations

import io
from pathlib import Path

from verefine_viz.core.errors import InputError, one_line, unknown
from verefine_viz.core.writing import atomic
from verefine_viz.methods.known_methods import method_of
from verefine_viz.page.branch import Branch
from verefine_viz.page.frame_objects import labels_of
from verefine_viz.page.page_state import PageState
from verefine_viz.page.views.film_moments import maps_in, tau_m_of
from verefine_viz.page.views.verdict import films, verdict_message
from verefine_viz.pictures.film import Film


def write_film(d: PageState, path: Path, branch: Branch | None = None, instance: int | None = None) -> str:
    """Write the film of an object; the ending of ``path`` says which kind.

    Args:
        d: what is open.
        path: ``.gif``, else a PNG.
        branch: the run; None = the first.
        instance: of the object; None = the worst.

    Returns:
        What it tells, a line for each picture.

    Raises:
        InputError: there is no such object, it has no answer, or the run is not over.
    """
    branch = branch or d.space.work.first
    problem, entry = branch.run.problem, d.batch_rows(branch)
    found = films(branch, entry)
    if not found:
        raise InputError("there is no film of a run that is not over, or has no answer")
    worst = verdict_message(branch, entry).scene.worst
    own = instance if instance is not None else worst if worst in found else next(iter(found))
    if own not in found:
        raise InputError(unknown("object with an answer", own, list(found)))
    target, moments = problem.target(own), found[own]
    label, method = labels_of(problem)[own], method_of(branch.settings.method.name).label
    title = f"{label}   {one_line(branch.settings.title or problem.title)}, frame {problem.frame}, {method}"
    film, out = Film(target, moments, maps_in(branch, target), tau_m_of(branch)), io.BytesIO()
    film.save(out, title, path.suffix.lower() == ".gif")
    with atomic(path) as part:
        part.write_bytes(out.getvalue())
    return "\n".join([title, *(f"{moment.title}: {moment.caption}" for moment in moments)])
