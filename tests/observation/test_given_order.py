"""An order given by a person: what it may hold, and what is said where it does not fit the frame."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.observation.boxes import Box, box_scene
from verefine_viz.core.algorithm_settings import DependencySettings
from verefine_viz.core.errors import InputError, SettingsError, VerefineError
from verefine_viz.observation.dependency_graph import dependency_graph
from verefine_viz.observation.given_order import read_orders

SIZE = (0.06, 0.06, 0.05)
BOXES = (
    Box(-0.10, 0.0, 0.0, SIZE, obj_id=8),
    Box(-0.10, 0.0, 0.05, (0.04, 0.04, 0.03), obj_id=2),
    Box(0.10, 0.0, 0.0, SIZE, obj_id=3),
    Box(0.0, -0.12, 0.0, SIZE, obj_id=3),
)
PROBLEM = box_scene(BOXES)
Order = tuple[tuple[int | str, ...], ...]


def graph(order: Order = (), order_file: str = "", cut: tuple[tuple[int, int], ...] = ()):
    return dependency_graph(PROBLEM, DependencySettings(order=order, order_file=order_file, cut=cut))


def test_a_given_order_wins_and_the_evidence_is_still_shown() -> None:
    found = graph((("#3",), (8, 2), ("#2",)))
    assert found.source == "given"
    assert found.clusters == ((3,), (0, 1), (2,))
    assert found.support_lists == ((3,), (0, 1), (2,))
    assert found.edges == graph().edges
    assert found.notes == ()


def test_an_object_that_is_there_twice_is_named_and_unknown_ids_are_ignored() -> None:
    found = graph(((8, 2), (3,)))
    assert found.clusters == ((0, 1), (2, 3))
    (note,) = found.notes
    assert "object 3 is in the frame 2 times, as box3 (#2) and box3 (#3)" in note
    assert '"#2" or "#3"' in note
    found = graph(((99, 8, 2), ("#77",), ("#2", "#3")))
    assert found.clusters == ((0, 1), (2, 3))
    assert found.notes == (
        "given order: unknown object 99; available: 2, 3, 8; it is ignored",
        "given order: unknown instance '#77'; available: #0, #1, #2, #3; it is ignored",
    )


def test_a_cyclic_order_counts_the_first_place() -> None:
    found = graph(((8, 2, 8), ("#2", "#3"), ("#1",)))
    assert found.clusters == ((0, 1), (2, 3))
    assert found.notes == (
        "the given order names box8 (#0) twice; its first place counts",
        "the given order names box2 (#1) twice; its first place counts",
    )


def test_what_is_not_named_comes_behind() -> None:
    found = graph(((3,),))
    assert found.clusters[0] == (2, 3)
    assert sorted(found.clusters[1:]) == [(0,), (1,)]
    assert found.clusters[1:] == ((0,), (1,))  # what carries still comes first
    assert "the given order does not name box8 (#0), box2 (#1); solved behind, each alone" in found.notes


def test_an_order_against_what_is_seen_is_followed_and_said() -> None:
    found = graph(((2, 8), ("#2",), ("#3",)))
    assert found.clusters[0] == (1, 0)
    (note,) = found.notes
    assert note.startswith("the given order solves box2 (#1) before box8 (#0), which seems to carry it (")


def test_orders_of_a_file_hold_for_their_frame(tmp_path: Path) -> None:
    path = tmp_path / "orders.json"
    path.write_text('{"0/1": [["#3"], [8, 2], ["#2"]], "0/7": [[8]]}')
    assert graph(order_file=str(path)).clusters == ((3,), (0, 1), (2,))
    path.write_text('{"0/7": [[8]]}')
    found = graph(order_file=str(path))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert graph(order_file=str(path)).clusters == found.clusters
    assert found.source == "recommended"
    assert found.clusters == graph().clusters
    assert "the order file gives none for frame 0/1; the recommended rule's is used" in found.notes
    assert graph((("#3",), (8, 2), ("#2",)), str(path)).source == "given"  # the session's own order wins


def test_a_file_that_holds_no_orders_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "orders.json"
    for content in ("", "{", "[" * 100_000, "[[8, 2]]", "3", '{"0/1": 8}', '{"0/1": [[null]]}', '{"0/9": [["#-1"]]}'):
        path.write_text(content)
        with pytest.raises(InputError, match=re.escape(f"order file {path}: ")) as error:
            graph(order_file=str(path))
        assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="order file"):
        graph(order_file=str(tmp_path))


def test_a_malformed_order_in_the_session() -> None:
    with pytest.raises(
        SettingsError, match=r"^dependency\.order: Expected .* - at `\$\[0\]\[0\]`; expected a list of clusters"
    ):
        graph((("mug",),))


ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)


@given(ANY_JSON)
def test_any_json_is_read_or_refused_in_one_line(tmp_path_factory: pytest.TempPathFactory, data: Any) -> None:
    path = tmp_path_factory.getbasetemp() / "any.json"
    path.write_text(json.dumps(data))
    message = ""
    try:
        assert isinstance(read_orders(path), dict)
    except VerefineError as error:
        message = str(error)
    assert "\n" not in message


@given(st.lists(st.lists(st.integers(0, 9) | st.integers(0, 6).map(lambda i: f"#{i}"), max_size=4), max_size=4))
def test_every_instance_appears_once_whatever_is_given(entries: list[list[int | str]]) -> None:
    found = graph(tuple(tuple(cluster) for cluster in entries))
    assert sorted(found.order) == [0, 1, 2, 3]
    assert all(found.clusters)
    assert all("\n" not in note for note in found.notes)
