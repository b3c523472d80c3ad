"""Sessions that differ from another in some settings: the other side of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
from msgspec import structs

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.presets import PRESETS, preset_fields
from verefine_viz.core.settings import Change, Session
from verefine_viz.run.session_file import resolve

SAME_FRAME = ("scene", "data", "breakpoints", "recording", "edits", "starts", "changes", "title")
"""What cannot be changed for a comparison, since both sides show the same frame, or has no effect on it."""
Changes = Sequence[tuple[str, Any]]


def variant(session: Session, changes: Changes) -> Session:
    """``session`` from its start, with some settings replaced.

    Args:
        session: what is varied; edited poses and settings changed during the run are left out.
        changes: (("method.name", "sir"), …); ("preset", "published") sets all that the preset sets, its refiner too,
            and puts back to its default what other presets set, before the others are applied. A refiner alone leaves
            colour and flips as they are.

    Raises:
        SettingsError: an unknown field, a value out of range, or a setting that makes it another frame.
    """
    raw = msgspec.to_builtins(structs.replace(session, edits=(), changes=()))
    refiner = dict(changes).get("method.refiner")
    for name, value in sorted(changes, key=lambda change: change[0] != "preset"):
        if name == "preset":
            _set_preset(raw, value, None if refiner is None else str(refiner))
            continue
        section, _, key = name.partition(".")
        if section in SAME_FRAME or section not in raw or not key:
            allowed = ("preset", *(s for s in raw if s not in (*SAME_FRAME, "preset")))
            raise SettingsError(unknown("section to compare", section, allowed))
        raw[section] = {**raw[section], key: value}
    # Every field is explicit, so the preset fills in nothing.
    return resolve(raw, "compared settings")


def _set_preset(raw: dict[str, Any], preset: Any, refiner: str | None) -> None:
    if preset not in tuple(PRESETS):
        raise SettingsError(unknown("preset", preset, PRESETS))
    defaults = msgspec.to_builtins(Session())
    set_before = (*PRESETS.values(), preset_fields(raw["preset"], raw["method"]["refiner"]))
    back = [{s: {name: defaults[s][name] for name in of} for s, of in fields.items()} for fields in set_before]
    for fields in (*back, preset_fields(preset, refiner)):
        for section in fields.keys() - SAME_FRAME:
            raw[section] = {**raw[section], **fields[section]}
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


def sorted_changes(changes: Sequence[Change]) -> list[Change]:
    """Sort changes, the earliest first."""
    return sorted(changes, key=lambda change: change.after_iteration)
