"""Sessions that differ from another in some settings: the other side of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
from msgspec import structs

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.settings import PUBLISHED, Session
from verefine_viz.run.session_file import resolve

SAME_FRAME = ("scene", "breakpoints", "recording", "edits", "changes", "title")
"""What cannot be changed for a comparison, since both sides show the same frame, or has no effect on it."""
Changes = Sequence[tuple[str, Any]]


def variant(session: Session, changes: Changes) -> Session:
    """``session`` from its start, with some settings replaced.

    Args:
        session: what is varied; edited poses and settings changed during the run are left out.
        changes: (("method.name", "sir"), …); ("preset", "published") sets all that the preset sets, or with
            "recommended" puts it back to the defaults, before the others are applied.

    Raises:
        SettingsError: an unknown field, a value out of range, or a setting that makes it another frame.
    """
    raw = msgspec.to_builtins(structs.replace(session, edits=(), changes=()))
    for name, value in sorted(changes, key=lambda change: change[0] != "preset"):
        if name == "preset":
            _set_preset(raw, value)
            continue
        section, _, key = name.partition(".")
        if section in SAME_FRAME or section not in raw or not key:
            allowed = ("preset", *(s for s in raw if s not in (*SAME_FRAME, "preset")))
            raise SettingsError(unknown("section to compare", section, allowed))
        raw[section] = {**raw[section], key: value}
    # Every field is explicit, so the preset fills in nothing.
    return resolve(raw, "compared settings")


def _set_preset(raw: dict[str, Any], preset: Any) -> None:
    if preset not in ("recommended", "published"):
        raise SettingsError(unknown("preset", preset, ("recommended", "published")))
    defaults = msgspec.to_builtins(Session())
    for section, fields in PUBLISHED.items():
        values = fields if preset == "published" else {name: defaults[section][name] for name in fields}
        raw[section] = {**raw[section], **values}
    raw["preset"] = preset


def settings_between(a: Session, b: Session) -> tuple[tuple[str, Any, Any], ...]:
    """What differs: (dotted name, value of A, value of B), in the order of a session file."""
    differing: list[tuple[str, Any, Any]] = []
    ours, theirs = msgspec.to_builtins(a), msgspec.to_builtins(b)
    for section, value in ours.items():
        if section in SAME_FRAME:
            continue
        if not isinstance(value, dict):
            differing += [(section, value, theirs[section])] if value != theirs[section] else []
            continue
        differing += [(f"{section}.{k}", v, theirs[section][k]) for k, v in value.items() if v != theirs[section][k]]
    return tuple(differing)


def scores_alike(a: Session, b: Session) -> bool:
    """Whether both score a pose by the same rule."""

    # Two renderers of one rule agree to the last digits that matter.
    def rule(s: Session) -> Any:
        return structs.replace(s.score, renderer="auto")

    return rule(a) == rule(b)
