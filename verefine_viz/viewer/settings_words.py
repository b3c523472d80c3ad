"""The sentence above the settings: what holds now that is not usual, and what a change that was typed will do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from verefine_viz.core.listing import first_of
from verefine_viz.core.settings import Session
from verefine_viz.session.files import resolve
from verefine_viz.viewer.changes import current_values

MOST = 3
"""Settings that are named; of more only how many."""


def settings_words(session: Session, labels: Mapping[str, str], typed: Mapping[str, Any], cursor: int) -> str:
    """As in: As recommended, but c 0.4, not 0.7. Changes wait for Restart or Fork.

    Args:
        session: the settings that hold.
        labels: by dotted name of a setting, what the panel calls it.
        typed: values in the fields by dotted name.
        cursor: the iteration that a fork would go on from.
    """
    held = current_values(session, tuple(labels))
    changes = waiting(session, labels, typed)
    if changes:
        kept = (
            f"keeps iterations 1 to {cursor}" if cursor > 1 else "keeps iteration 1" if cursor else "is the same here"
        )
        return f"Not in use yet: {first_of(changes, MOST)}. Restart begins anew with it; Fork {kept}."
    usual = current_values(resolve({"preset": session.preset}), tuple(labels))
    other = [
        f"{labels[name]} {_shown(held[name])}, not {_shown(usual[name])}"
        for name in labels
        if held[name] != usual[name]
    ]
    of = "as published" if session.preset == "published" else "as recommended"
    if not other:
        return f"All {of}. Changes wait for Restart or Fork."
    return f"{of.capitalize()}, but {first_of(other, MOST, '; ')}. Changes wait for Restart or Fork."


def waiting(session: Session, labels: Mapping[str, str], typed: Mapping[str, Any]) -> tuple[str, ...]:
    """What was typed and is not in use yet, as in: c 0.7 → 0.4. Takes what :func:`settings_words` does."""
    held = current_values(session, tuple(labels))
    return tuple(
        f"{labels[name]} {_shown(held[name])} → {_shown(value)}" for name, value in typed.items() if value != held[name]
    )


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, int | float) else str(value)
