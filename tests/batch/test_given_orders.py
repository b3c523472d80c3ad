"""A given order that cannot be meant is refused before the first frame, whatever the frames hold."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.batch.frames import make_frames, write_session
from tests.scenes.bop_folder import Made
from verefine_viz import cli
from verefine_viz.batch.session_check import check
from verefine_viz.run.session_file import load_session

pytestmark = pytest.mark.usefixtures("processes")

FRAMES = ("7/0", "7/1")


@dataclass(frozen=True)
class BadInput:
    """Two frames of objects 2, 5 and 2."""

    folder: Path
    made: Made
    capsys: pytest.CaptureFixture[str]

    def session(self, **dependency: Any) -> Path:
        return write_session(self.folder, self.made, dependency=dependency)

    def refused(self, **dependency: Any) -> str:
        assert cli.main(["batch", str(self.session(**dependency)), "--out", str(self.folder / "out")]) == 2
        (line,) = self.capsys.readouterr().err.splitlines()
        assert not (self.folder / "out").exists()
        return line.removeprefix("verefine-viz: ")


@pytest.fixture
def bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> BadInput:
    return BadInput(tmp_path, make_frames(tmp_path / "data", len(FRAMES)), capsys)


def orders(folder: Path, content: object) -> str:
    path = folder / "orders.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(path)


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ([[2, 99]], "dependency.order: unknown object 99; available: 2, 5"),
        ([[5, 2], [2, 5]], "dependency.order runs in a circle: it names 2 twice; name what supports others first"),
    ],
)
def test_an_order_that_cannot_be_meant(order: list[Any], words: str, bad_input: BadInput) -> None:
    assert words in bad_input.refused(order=order)
    path = orders(bad_input.folder, {"7/1": order})
    assert words.removeprefix("dependency.order") in bad_input.refused(order_file=path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "orders.json does not exist"),
        ("{", "orders.json: not JSON"),
        ({"7-1": [[2]]}, "orders.json: frame '7-1' is not \"scene/image\""),
        ({"07/1": [[2]]}, "orders.json: frame '07/1' is called '7/1'; rename it"),
    ],
)
def test_an_order_file_that_cannot_be_used(content: object, words: str, bad_input: BadInput) -> None:
    path = orders(bad_input.folder, content) if content is not None else str(bad_input.folder / "orders.json")
    assert words in bad_input.refused(order_file=path)


def test_orders_that_can_be_meant(bad_input: BadInput) -> None:
    assert check(load_session(bad_input.session(order=[[5, 2]]))) == (FRAMES, ())
    assert check(load_session(bad_input.session(order=[["#0", 5], ["#2"], ["#77"]]))) == (FRAMES, ())
    # What is said about frames that are not asked for does not matter, nor what an object set aside would be.
    path = orders(bad_input.folder, {"7/0": [[2, 5]], "7/9": [[99]]})
    assert check(load_session(bad_input.session(order_file=path), {"scene": {"objects": (5,)}})) == (FRAMES, ())
