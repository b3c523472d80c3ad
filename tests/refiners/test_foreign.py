"""What a refiner of another program raises is told as its own, wherever that comes from."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.fakes import box_problem
from verefine_viz.core.settings import Session
from verefine_viz.refiners.icp import Icp
from verefine_viz.refiners.registry import REFINERS, make_refiner, raised_by_refiner

HERE = Path(__file__)
TARGET = box_problem().targets[0]


class Broken:
    """Fails in a way of its own."""

    def __init__(self, fail: Callable[[], object]) -> None:
        self._fail = fail

    def refine(self, target: object, T_cam_obj: object, fixed: object = ()) -> object:
        return self._fail()  # here


class TakesTwo:
    """Its author forgot an argument."""

    def refine(self, target: object, T_cam_obj: object) -> object:
        return T_cam_obj


def error_of(make: Callable[[Session], object], monkeypatch: pytest.MonkeyPatch) -> Exception:
    monkeypatch.setitem(REFINERS, "nudge", make)
    with pytest.raises(Exception) as raised:  # noqa: PT011 the tests look at which it is
        make_refiner("nudge", Session()).refine(TARGET, np.eye(4))
    return raised.value


def line_of(words: str) -> int:
    return 1 + next(k for k, line in enumerate(HERE.read_text().splitlines()) if words in line)


def test_a_refiner_that_raises_is_named_with_the_line_that_called(monkeypatch: pytest.MonkeyPatch) -> None:
    error = error_of(lambda session: Broken(lambda: 1 / 0), monkeypatch)
    line = line_of("Broken(lambda: 1 / " + "0)")
    assert raised_by_refiner(error) == f"the refiner 'nudge' raised ZeroDivisionError: division by zero ({HERE}:{line})"
    error = error_of(lambda session: Broken(lambda: np.linalg.inv(np.zeros((2, 2)))), monkeypatch)
    assert raised_by_refiner(error).endswith(f"Singular matrix ({HERE}:{line_of('np.linalg.' + 'inv')})")
    error = error_of(lambda session: Broken(lambda: Icp(None).refine(TARGET, None)), monkeypatch)  # type: ignore[arg-type]
    assert raised_by_refiner(error).endswith(f"({HERE}:{line_of('Icp(No' + 'ne)')})")


def test_without_a_frame_of_its_own_or_where_it_cannot_be_built_it_is_named_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said = raised_by_refiner(error_of(lambda session: TakesTwo(), monkeypatch))
    assert said.startswith("the refiner 'nudge' raised TypeError: ")
    assert said.endswith("were given")
    error = error_of(lambda session: Broken(sys.nothing), monkeypatch)  # type: ignore[attr-defined]
    assert raised_by_refiner(error).startswith("the refiner 'nudge' raised AttributeError: ")


def test_what_goes_wrong_elsewhere_is_no_refiners() -> None:
    assert raised_by_refiner(RuntimeError("lost")) == ""
    with pytest.raises(AttributeError) as raised:
        make_refiner("icp", Session()).refine(None, np.eye(4))  # type: ignore[arg-type]
    assert raised_by_refiner(raised.value) == ""
