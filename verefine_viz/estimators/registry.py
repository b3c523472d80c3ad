"""Estimators by name. A new one is a class with ``hypotheses`` (core.protocols.Estimator) and a line in ``ESTIMATORS``.

Each is imported when it is first asked for: one that cannot be loaded does not keep the others away.
"""

from __future__ import annotations

from collections.abc import Callable

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.own_parts import NO_PARTS, OwnParts
from verefine_viz.core.protocols import Estimator
from verefine_viz.core.settings import Session


def _ppf(session: Session) -> Estimator:
    from verefine_viz.estimators.ppf import Ppf

    return Ppf(session.ppf)


def _pcs(session: Session) -> Estimator:
    from verefine_viz.estimators.pcs import Pcs

    return Pcs(session.pcs)


def _densefusion(session: Session) -> Estimator:
    from verefine_viz.estimators.densefusion_pool import DenseFusionPool

    return DenseFusionPool(session.densefusion)


def _densefusion_hash(session: Session) -> str:
    from verefine_viz.networks.densefusion_weights import weights_hash

    return weights_hash(session.densefusion, with_refiner=False)


ESTIMATORS: dict[str, Callable[[Session], Estimator]] = {"ppf": _ppf, "pcs": _pcs, "densefusion": _densefusion}
WEIGHTS: dict[str, Callable[[Session], str]] = {"densefusion": _densefusion_hash}
"""Hash of the weights of each learned estimator, for recordings and run.json."""


def make_estimator(name: str, session: Session, own: OwnParts = NO_PARTS) -> Estimator:
    """The estimator of a name with the session's settings; ``own``, parts of the caller, take precedence.

    Raises:
        SettingsError: no estimator has that name; lists those that exist.
    """
    if name in own.estimators:
        return own.estimators[name]
    if name not in ESTIMATORS:
        raise SettingsError(unknown("estimator", name, ESTIMATORS))
    return ESTIMATORS[name](session)
