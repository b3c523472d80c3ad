"""JSON files of a data set: what is refused, in one line that names the file, and keys that are numbers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from verefine_viz.core.json_files import MOST_NESTED, id_of, number_of, position_of, read_json, read_numbered

from verefine_viz.core.errors import InputError


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 2000 + "]" * 2000, "its brackets are nested more than 40 deep"),
        ("[" * (MOST_NESTED + 1) + "]" * (MOST_NESTED + 1), "its brackets are nested more than 40 deep"),
        ("[" * 100_000, "its brackets are nested more than 40 deep"),
        (f"[{'9' * 5000}]", "a number has more than 4300 digits"),
        ('[{"a": 1, "b": 2, "a": 3}]', "has the key 'a' twice in one object; delete one of them"),
        ("[1,", "is not JSON: Expecting value in line 1"),
        ("3", "holds a JSON int, expected a list"),
    ],
    ids=["brackets", "a bracket too many", "brackets without end", "digits", "a key twice", "cut off", "a number"],
)
def test_what_is_refused_is_one_line_with_the_file(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "some.json"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        read_json(path, list)
    said = str(refused.value)
    assert said.startswith(str(path))
    assert words in said
    assert "\n" not in said
    assert len(said) < 300


def test_brackets_as_deep_as_is_allowed_are_read(tmp_path: Path) -> None:
    path = tmp_path / "some.json"
    path.write_text("[" * MOST_NESTED + "]" * MOST_NESTED)
    assert len(read_json(path, list)) == 1


def test_keys_are_numbers_whatever_zeros_are_in_front(tmp_path: Path) -> None:
    path = tmp_path / "some.json"
    path.write_text(json.dumps({"000012": "a", "0": "b", "7": "c"}))
    assert read_numbered(path, "image") == {12: "a", 0: "b", 7: "c"}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"1": 0, "000001": 1}, "has '1' and '000001' for the same image; delete one of them"),
        ({"left": 0}, "has 'left' for an image, expected its number, as in {'0': …, '1': …}"),
        ({"-1": 0}, "has '-1' for an image"),
        ({"١": 0}, "has '١' for an image"),
        ({"9" * 5000: 0}, "9… for an image"),
    ],
    ids=["twice", "a word", "negative", "arabic", "digits"],
)
def test_keys_that_are_no_numbers_or_twice_the_same(tmp_path: Path, content: dict[str, int], words: str) -> None:
    path = tmp_path / "some.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as refused:
        read_numbered(path, "image")
    assert words in str(refused.value)
    assert len(str(refused.value)) < 300


def test_what_counts_as_an_id() -> None:
    assert [id_of(text) for text in ("5", "000005", "0", "9" * 18)] == [5, 5, 0, 10**18 - 1]
    assert [id_of(text) for text in ("", "a", "-1", "1.0", "²", " 1", "9" * 19, "0" * 200)] == [None] * 8


def test_numbers_have_bounds_which_the_message_names() -> None:
    assert number_of({"d": 5}, "d", "here", 1, 10, "1 to 10 mm") == 5.0
    with pytest.raises(InputError, match=r"^here: 'd' is 1e\+37, expected 1 to 10 mm$"):
        number_of({"d": 1e37}, "d", "here", 1, 10, "1 to 10 mm")
    with pytest.raises(InputError, match="'d' is nan, expected a finite number"):
        number_of({"d": float("nan")}, "d", "here", 1, 10, "1 to 10 mm")


def test_positions_have_a_reach() -> None:
    assert position_of({"t": [0, 0, 99_000]}, "t", "here").tolist() == [0, 0, 99_000]
    with pytest.raises(InputError, match=r"^here: 't' is 1e\+27 m away, expected at most 100 m; is it in millimetres"):
        position_of({"t": [0, 0, 1e30]}, "t", "here")
