"""One door to data sets and built-in scenes alike."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.fakes import box_problem
from tests.scenes.bop_folder import make
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.source import DemoSource, open_scene


@pytest.fixture
def made_up_demos(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Stands in for the built-in scenes; the list tells which were made."""
    made: list[str] = []
    module = ModuleType("verefine_viz.scenes.demo")

    def demo_problem(name: str, scene: SceneSettings, hypotheses: HypothesesSettings):
        made.append(name)
        return box_problem()

    module.__dict__.update(demo_names=lambda: ("box", "mug"), demo_problem=demo_problem)
    monkeypatch.setitem(sys.modules, "verefine_viz.scenes.demo", module)
    return made


def test_a_demo_has_one_frame_and_is_made_once(made_up_demos: list[str]) -> None:
    source = open_scene(SceneSettings(source="demo", demo="mug"), HypothesesSettings())
    assert isinstance(source, DemoSource)
    assert made_up_demos == []
    (frame,) = source.frames
    problem = source.problem(frame)
    assert problem.frame == frame
    assert source.problem(frame) is problem
    assert made_up_demos == ["mug"]


def test_unknown_demos_and_frames_list_what_there_is(made_up_demos: list[str]) -> None:
    with pytest.raises(InputError, match="unknown demo scene 'teapot'; available: box, mug"):
        open_scene(SceneSettings(source="demo", demo="teapot"), HypothesesSettings())
    with pytest.raises(InputError, match="unknown frame '1/1'; available: 0/0"):
        open_scene(SceneSettings(source="demo", demo="box"), HypothesesSettings()).problem("1/1")


def test_a_folder_opens_as_a_data_set(tmp_path: Path) -> None:
    made = make(tmp_path)
    source = open_scene(SceneSettings(source="bop", dataset=str(made.root)), HypothesesSettings())
    assert source.problem(source.frames[0]).frame == made.frame
