"""Refiners of which only another program knows: what was made with one can be run again through that program alone."""

from __future__ import annotations

from collections.abc import Iterator

from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.methods.registry import method_of
from verefine_viz.refiners.registry import REFINERS
from verefine_viz.session.files import changed


def check_refiners(session: Session, what: str, to_do: str, words: str) -> None:
    """That this program has every refiner with which something was made.

    Args:
        session: how it was made.
        what: what was made, as "recording run.rrd".
        to_do: what was to be done with it now, as "verify".
        words: the words that do so, as "replay run.rrd --verify".

    Raises:
        SettingsError: a refiner is not there; the text says through which program to do it.
    """
    for name in _refiners(session):
        if name not in REFINERS:
            raise SettingsError(
                f"{what} was made with the refiner {name!r}, which this program does not have "
                f"(it has {', '.join(REFINERS)}); {to_do} it through the program that does, as in the README's "
                f'"Your own refiner": python PROGRAM.py {words}'
            )


def _refiners(session: Session) -> Iterator[str]:
    """The refiners that a run of the session needs, also after settings that change on its way."""
    stages = [session]
    for change in sorted(session.changes, key=lambda change: change.after_iteration):
        stages.append(changed(stages[-1], change.settings))
    for stage in stages:
        if not method_of(stage.method.name).has_tree:  # It has a refiner of its own.
            yield stage.method.refiner
