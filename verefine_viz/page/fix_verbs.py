"""The verb that tries remedies on the answers of the gallery, and writes the session with those that are chosen."""

from __future__ import annotations

import os
from pathlib import Path

from verefine_viz.batch.fix_command import FixRequest, write_sessions
from verefine_viz.core.errors import InputError
from verefine_viz.core.writing import check_file, expand_home
from verefine_viz.page import protocol as p
from verefine_viz.page.gallery import open_gallery
from verefine_viz.page.page_state import PageState


def fix(d: PageState, verb: p.Fix, window: int | None) -> None:
    """Begin to try remedies, end that, or write a session.

    Raises:
        VerefineError: no batch is open, or what is written was not tried.
    """
    if verb.stop:
        d.end_fix()
        return
    folder = open_gallery(d.gallery).folder
    if folder is None:
        raise InputError("remedies are tried on the runs of one folder; open it with verefine-viz view FOLDER")
    if d.fix is not None and d.fix.latest.is_running:
        raise InputError("remedies are being tried; end that first")
    table = d.known_fix().table
    every = verb.every if table is None or not verb.take else table.every
    request = FixRequest(folder=folder, every=every, seed=0 if table is None else table.seed, together=verb.take)
    if not verb.write:
        d.begin_fix(request, max(os.cpu_count() or 1, 1))
        return
    path = Path(expand_home(verb.write))
    check_file(path, "mended.toml", "the session")
    runs = request.runs()
    written = write_sessions(verb.take, request.trials(runs), runs, path)
    d.say(f"Session in {', '.join(map(str, written))}", window)
