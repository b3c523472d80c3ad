"""Every number that can be set has bounds, which the help shows; they admit all that ships."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.inspect import FloatType, IntType, StructType, Type, UnionType

from verefine_viz.core.presets import PRESETS
from verefine_viz.core.setting_types import fields_of, limits
from verefine_viz.core.settings import Change, Edit, Session
from verefine_viz.run.session_file import load_session, resolve

SESSIONS = sorted((Path(__file__).resolve().parents[2] / "sessions").glob("*.toml"))


def kinds_of(model: type[Any], prefix: str = "") -> Iterator[tuple[str, Type]]:
    for name, field in fields_of(model).items():
        if isinstance(field.type, StructType):
            yield from kinds_of(field.type.cls, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", field.type


NUMBERS = {
    name: kind
    for name, kind in (*kinds_of(Session), *kinds_of(Edit, "edit."), *kinds_of(Change, "change."))
    if any(isinstance(way, IntType | FloatType) for way in (kind.types if isinstance(kind, UnionType) else (kind,)))
}


def test_numbers_are_looked_at() -> None:
    assert len(NUMBERS) > 60
    assert {"physics.steps", "mcts.seconds", "edit.instance", "change.after_iteration"} <= NUMBERS.keys()


def test_every_number_has_a_lower_and_an_upper_bound() -> None:
    bounds = re.compile(r"from \S+ to \S+|(at least|above) \S+ and (at most|below) \S+")
    assert [name for name, kind in NUMBERS.items() if not bounds.fullmatch(limits(kind))] == []


def test_what_is_beyond_sense_is_refused() -> None:
    for name in (name for name in NUMBERS if name.count(".") == 1 and "edit" not in name):
        section, field = name.split(".")
        model = Change if section == "change" else type(getattr(Session(), section))
        for value in (1e12, 10**20, 1e308, float("inf"), float("nan")):
            # "DID NOT RAISE" shows name and value among the locals.
            with pytest.raises(msgspec.ValidationError, match=rf"\$.{field}`$"):
                msgspec.convert({field: value, **({"settings": {}} if model is Change else {})}, model, strict=False)


@pytest.mark.parametrize("preset", PRESETS)
def test_the_bounds_admit_what_ships(preset: str) -> None:
    resolve({"preset": preset})
    assert [load_session(path, {"preset": preset}).preset for path in SESSIONS] == [preset] * len(SESSIONS)


def test_the_defaults_are_within_the_bounds() -> None:
    assert msgspec.convert(msgspec.to_builtins(Session()), Session) == Session()
