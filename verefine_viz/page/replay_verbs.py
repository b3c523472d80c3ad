"""Carries out a log of verbs again, which gives the same records bit for bit."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING

from verefine_viz.core.settings import Session
from verefine_viz.page.gallery import Gallery
from verefine_viz.page.protocol import Seek, read_verb
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace, no_records

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox


def carry_out(
    session: Session,
    lines: Iterable[str],
    make_tools: Callable[[Session], Toolbox] | None = None,
    gallery: Gallery | None = None,
) -> Debugger:
    """Carry out exported verbs.

    Args:
        session: with which the program began.
        lines: of the file.
        make_tools: builds the algorithm's parts from a session; None = the real ones.
        gallery: whose answers were opened, if any were.

    Raises:
        VerefineError: a line is no verb, or cannot be carried out.
    """
    if make_tools is None:
        from verefine_viz.run.toolbox import Toolbox

        make_tools = partial(Toolbox)
    records = gallery.records(gallery.worst.run) if gallery is not None else no_records
    debugger = Debugger(Workspace(session, None, make_tools, records=records), gallery=gallery)
    for line in filter(str.strip, lines):
        verb = read_verb(line)
        debugger.goals.clear()  # How far a run came is a verb of its own.
        debugger.apply(None, verb)
        while isinstance(verb, Seek) and debugger.is_running:
            debugger.tick()
    debugger.goals.clear()
    return debugger
