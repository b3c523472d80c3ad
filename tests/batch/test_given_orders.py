"""What a batch cannot mean is refused before the first frame, whatever the frames hold: orders, folders of grasps."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.batch.conftest import N_FRAMES
from tests.batch.frames import write_session
from tests.scenes.bop_folder import Made
from verefine_viz.batch.session_check import check
from verefine_viz.core.errors import VerefineError
from verefine_viz.run.session_file import load_session

pytestmark = pytest.mark.usefixtures("processes")

FRAMES = tuple(f"7/{k}" for k in range(N_FRAMES))
Checked = Callable[..., tuple[tuple[str, ...], tuple[str, ...]]]


@pytest.fixture
def checked(made: Made, tmp_path: Path) -> Checked:
    """What is found about frames of objects 2, 5 and 2, with these sections of their session."""

    def of(overrides: dict[str, Any] | None = None, **sections: dict[str, object]) -> Any:
        return check(load_session(write_session(tmp_path, made, **sections), overrides))

    return of


def orders(folder: Path, content: object) -> str:
    path = folder / "orders.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(path)


@pytest.mark.parametrize(("order", "said"), [([[2, 99]], "99; available: 2, 5"), ([[5, 2], [2, 5]], "circle")])
def test_an_order_that_cannot_be_meant(order: list[Any], said: str, checked: Checked, tmp_path: Path) -> None:
    with pytest.raises(VerefineError, match=said):
        checked(dependency={"order": order})
    with pytest.raises(VerefineError, match=said):
        checked(dependency={"order_file": orders(tmp_path, {"7/1": order})})


@pytest.mark.parametrize(
    ("content", "said"),
    [(None, "orders.json"), ("{", "orders.json"), ({"7-1": [[2]]}, "'7-1'"), ({"07/1": [[2]]}, "'07/1'")],
)
def test_an_order_file_that_cannot_be_used(content: object, said: str, checked: Checked, tmp_path: Path) -> None:
    path = tmp_path / "orders.json" if content is None else orders(tmp_path, content)
    with pytest.raises(VerefineError, match=said):
        checked(dependency={"order_file": str(path)})


def test_orders_that_can_be_meant(checked: Checked, tmp_path: Path) -> None:
    assert checked(dependency={"order": [[5, 2]]}) == (FRAMES, ())
    assert checked(dependency={"order": [["#0", 5], ["#2"], ["#77"]]}) == (FRAMES, ())
    # What is said about frames that are not asked for does not matter, nor what an object set aside would be.
    path = orders(tmp_path, {"7/0": [[2, 5]], "7/9": [[99]]})
    assert checked({"scene": {"objects": (5,)}}, dependency={"order_file": path}) == (FRAMES, ())


def test_a_folder_without_grasps(checked: Checked, tmp_path: Path) -> None:
    with pytest.raises(VerefineError, match=str(tmp_path / "none")):
        checked(grasp={"answers": True, "folder": str(tmp_path / "none")})
