"""Estimators by name. A new one is a class with ``hypotheses`` (core.protocols.Estimator) and a line in ``ESTIMATORS``.

Each is imported when it is first asked for: one that cannot be loaded does not keep the others away.
"""

from __future__ import annotations

from collections.abc import Callable

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.protocols import Estimator
from verefine_viz.core.settings import Session


def _ppf(session: Session) -> Estimator:
    from verefine_viz.estimators.ppf import Ppf

    return Ppf(session.ppf)


def _pcs(session: Session) -> Estimator:
    from verefine_viz.estimators.pcs import Pcs

    return Pcs(session.pcs)


ESTIMATORS: dict[str, Callable[[Session], Estimator]] = {"ppf": _ppf, "pcs": _pcs}


def make_estimator(name: str, session: Session) -> Estimator:
    """The estimator of that name with the session's settings.

    Raises:
        SettingsError: no estimator has that name; lists those that exist.
    """
    if name not in ESTIMATORS:
        raise SettingsError(unknown("estimator", name, ESTIMATORS))
    return ESTIMATORS[name](session)
