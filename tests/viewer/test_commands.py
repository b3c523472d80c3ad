"""Commands survive a file, and nothing else gets through."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any, get_args, get_origin, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.core.errors import InputError
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.command_json import COMMANDS, from_json, to_json

ANY_VALUE = st.one_of(st.booleans(), st.integers(-9, 9), st.floats(allow_nan=False, allow_infinity=False), st.text())


def values(hint: Any) -> st.SearchStrategy[Any]:
    if hint is Any:
        return ANY_VALUE
    known = {
        int: st.integers(), float: st.floats(allow_nan=False, allow_infinity=False), bool: st.booleans(),
        str: st.text(), type(None): st.none(),
    }  # fmt: skip
    if hint in known:
        return known[hint]
    if hint == c.Changes:
        return st.lists(st.tuples(st.text(), ANY_VALUE)).map(tuple)
    if hint == c.Pose:
        return st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=16, max_size=16).map(tuple)
    args = get_args(hint)
    if get_origin(hint) is tuple:
        return st.lists(values(args[0])).map(tuple) if args[-1] is ... else st.tuples(*map(values, args))
    if all(isinstance(a, str) for a in args):
        return st.sampled_from(args)
    return st.one_of(*(values(a) for a in args))


@st.composite
def any_command(draw: st.DrawFn) -> c.Command:
    cls = draw(st.sampled_from(list(COMMANDS.values())))
    hints = get_type_hints(cls)
    return cls(**{field.name: draw(values(hints[field.name])) for field in fields(cls)})


@given(any_command())
def test_json_and_back_is_the_same_command(command: c.Command) -> None:
    line = to_json(command)
    assert "\n" not in line
    assert from_json(line) == command


def test_anything_else_is_refused_in_one_line() -> None:
    for line, said in (
        ("", "not a command"),
        ("{", "not a command"),
        ("[]", "unknown command"),
        ('{"command": "Explode"}', "unknown command 'Explode'; available: Step"),
        ('{"command": "Seek"}', "missing"),
        ('{"command": "Seek", "cursor": "3"}', "cursor = '3' is not right: Expected `int`"),
        ('{"command": "Seek", "cursor": true}', "cursor = True is not right"),
        ('{"command": "Seek", "cursor": 3, "more": 1}', "no field 'more'"),
        ('{"command": "Export", "what": "/etc/passwd"}', "what = '/etc/passwd' is not"),
        ('{"command": "DragPose", "T_cam_obj": [1, "x"]}', "T_cam_obj = "),
    ):
        with pytest.raises(InputError, match="command") as error:
            from_json(line)
        assert said in str(error.value), line
        assert "\n" not in str(error.value), line


def test_every_command_is_registered() -> None:
    kinds = {c.Command, *c.Command.__subclasses__()}
    defined = {x for kind in kinds for x in kind.__subclasses__()}
    defined -= {x for x in defined if x.__subclasses__()}
    assert set(COMMANDS.values()) == defined
    assert all(json.loads(to_json(cls()))["command"] == name for name, cls in COMMANDS.items() if name == "Step")
