"""A given order that cannot be meant is refused before the first frame, whatever the frames hold."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.batch.frames import make_frames, write_session
from tests.cli.command_line import CommandLine
from verefine_viz.batch.session_check import check
from verefine_viz.run.session_file import load_session

pytestmark = pytest.mark.usefixtures("processes")

FRAMES = ("7/0", "7/1")


class BadInput(CommandLine):
    """Two frames of objects 2, 5 and 2."""

    def session(self, **dependency: Any) -> Path:
        return write_session(self.folder, self.made, dependency=dependency)

    def batch(self, **dependency: Any) -> str:
        line = self.refused("batch", self.session(**dependency), "--out", self.folder / "out")
        assert not (self.folder / "out").exists()
        return line


@pytest.fixture
def bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> BadInput:
    return BadInput(tmp_path, make_frames(tmp_path / "data", len(FRAMES)), capsys)


def orders(folder: Path, content: object) -> str:
    path = folder / "orders.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(path)


@pytest.mark.parametrize(
    ("order", "words"), [([[2, 99]], "unknown object 99; available: 2, 5"), ([[5, 2], [2, 5]], "in a circle")]
)
def test_an_order_that_cannot_be_meant(order: list[Any], words: str, bad_input: BadInput) -> None:
    assert words in bad_input.batch(order=order)
    assert words in bad_input.batch(order_file=orders(bad_input.folder, {"7/1": order}))


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "orders.json"), ("{", "orders.json"), ({"7-1": [[2]]}, "'7-1'"), ({"07/1": [[2]]}, "'07/1'")],
)
def test_an_order_file_that_cannot_be_used(content: object, words: str, bad_input: BadInput) -> None:
    path = orders(bad_input.folder, content) if content is not None else str(bad_input.folder / "orders.json")
    assert words in bad_input.batch(order_file=path)


def test_orders_that_can_be_meant(bad_input: BadInput) -> None:
    assert check(load_session(bad_input.session(order=[[5, 2]]))) == (FRAMES, ())
    assert check(load_session(bad_input.session(order=[["#0", 5], ["#2"], ["#77"]]))) == (FRAMES, ())
    # What is said about frames that are not asked for does not matter, nor what an object set aside would be.
    path = orders(bad_input.folder, {"7/0": [[2, 5]], "7/9": [[99]]})
    assert check(load_session(bad_input.session(order_file=path), {"scene": {"objects": (5,)}})) == (FRAMES, ())
