"""Changed settings in their two forms: by dotted name, as commands have them, and by section, as session files do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from verefine_viz.core.settings import Change, Session
from verefine_viz.viewer.command import Changes


def in_order(changes: Sequence[Change]) -> list[Change]:
    """The earliest first."""
    return sorted(changes, key=lambda change: change.after_iteration)


def nested(changes: Changes) -> dict[str, dict[str, Any]]:
    """(("method.exploration", 0.2),) as {"method": {"exploration": 0.2}}."""
    out: dict[str, dict[str, Any]] = {}
    for name, value in changes:
        section, _, key = name.partition(".")
        out.setdefault(section, {})[key] = value
    return out


def merged(parts: Sequence[Mapping[str, Mapping[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Several nested changes as one; later ones win."""
    out: dict[str, dict[str, Any]] = {}
    for part in parts:
        for section, values in part.items():
            out.setdefault(section, {}).update(values)
    return out


def current_values(session: Session, names: Sequence[str]) -> Mapping[str, Any]:
    """The values of settings by dotted name."""
    found = {}
    for name in names:
        section, _, key = name.partition(".")
        found[name] = getattr(getattr(session, section), key)
    return found
