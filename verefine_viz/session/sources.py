"""Data and estimators that a session names and then would not look at, or would look at twice: nobody means that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session

Layer = tuple[str, Mapping[str, Any]]
"""Where settings were written ("s.toml", "command line"), and what was written there, nested as in a session file."""

_READ_BY = {("scene", "dataset"): "bop", ("scene", "demo"): "demo", ("hypotheses", "files"): "results"}
"""The source (of the same section) that looks at a field."""
_ESTIMATORS = ("ppf", "pcs")
"""Sections that only an estimator of their name looks at."""


def check_sources(session: Session, layers: Sequence[Layer]) -> None:
    """Looks whether what was written down is read by the chosen sources.

    A source that was written together with a field, or over it, was chosen by somebody who knew; one that nobody wrote,
    or that was there before the field was, was forgotten.

    Args:
        session: what the layers add up to.
        layers: the later wins.

    Raises:
        SettingsError: a field is set that its section's source does not look at, and the source was not chosen with it;
            or a results file is named twice.
    """
    for (section, field), reader in _READ_BY.items():
        chosen = getattr(session, section)
        at = _last(layers, section, field)
        if getattr(chosen, field) and chosen.source != reader and _last(layers, section, "source") < at:
            name, source = f"{section}.{field}", f"{section}.source"
            raise SettingsError(
                f'{layers[at][0]}: {name} is set, but {source} is "{chosen.source}" and does not look at it; '
                f'set {source} = "{reader}", or leave {name} out'
            )
    hypotheses = session.hypotheses
    twice = [file for file in hypotheses.files if hypotheses.files.count(file) > 1]
    if twice and hypotheses.source == "results":
        where = layers[_last(layers, "hypotheses", "files")][0]
        raise SettingsError(f"{where}: hypotheses.files names {twice[0]} twice; name each file once")
    if _last(layers, "hypotheses", "source") >= 0:
        return
    for name in _ESTIMATORS:
        at = max((k for k, (_, raw) in enumerate(layers) if raw.get(name)), default=-1)
        if at >= 0 and name not in (kind for *_, kind in hypotheses.estimate):
            raise SettingsError(
                f'{layers[at][0]}: [{name}] is set, but hypotheses.source is "{hypotheses.source}" and does not look '
                f'at it; set hypotheses.source = "{name}", or say "{hypotheses.source}" there if that is meant'
            )


def _last(layers: Sequence[Layer], section: str, field: str) -> int:
    """Number of the last layer in which a field was written, from 0; -1 where none has it."""
    written = (raw.get(section) for _, raw in layers)
    return max((k for k, fields in enumerate(written) if isinstance(fields, Mapping) and field in fields), default=-1)
