"""Refiners by name. A new one is a class with ``refine`` (core.protocols.Refiner) and a line in ``REFINERS``."""

from __future__ import annotations

from collections.abc import Callable

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.settings import Session
from verefine_viz.refiners.foreign import is_foreign, made
from verefine_viz.refiners.icp import Icp
from verefine_viz.refiners.identity import Identity
from verefine_viz.refiners.trimmed_icp import TrimmedIcp

REFINERS: dict[str, Callable[[Session], Refiner]] = {
    "icp": lambda session: Icp(session.icp),
    "trimmed_icp": lambda session: TrimmedIcp(session.tricp),
    "identity": lambda session: Identity(),
}


def make_refiner(name: str, session: Session) -> Refiner:
    """The refiner of that name with the session's settings.

    Raises:
        SettingsError: no refiner has that name; lists those that exist.
    """
    if name not in REFINERS:
        raise SettingsError(unknown("refiner", name, REFINERS))
    make = REFINERS[name]
    return made(name, make, session) if is_foreign(make) else make(session)
