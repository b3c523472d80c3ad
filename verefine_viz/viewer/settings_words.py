"""The sentence above the settings: what holds now that is not usual, and what a change that was typed will do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from verefine_viz.core.errors import SettingsError
from verefine_viz.core.listing import first_of
from verefine_viz.core.settings import Session
from verefine_viz.session.files import AT_ITS_START, changed, resolve
from verefine_viz.viewer.changes import current_values, nested

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
    if mistake := _mistake(session, labels, typed):
        return f"{mistake}. Restart and Fork would refuse it."
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


def _mistake(session: Session, labels: Mapping[str, str], typed: Mapping[str, Any]) -> str | None:
    """What is wrong with the first value that no run can have, as in: K = -3: input should be greater than …"""
    held = current_values(session, tuple(labels))
    for name, value in typed.items():
        try:
            if value != held[name]:
                changed(session, nested(((name, value),)), (*AT_ITS_START, "hypotheses"))
        except SettingsError as error:
            return str(error).removeprefix("changed settings: ").replace(name, labels[name])
    return None


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, int | float) else str(value)
