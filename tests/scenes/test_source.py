"""One door to data sets and built-in scenes alike."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.scenes.bop_folder import make
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.source import DemoSource, open_scene


def demo(**fields: object) -> SceneSettings:
    return SceneSettings.model_validate({"source": "demo", "demo": "clutter", **fields})


def test_a_demo_has_a_frame_per_viewpoint_and_each_is_made_once() -> None:
    source = open_scene(demo(), HypothesesSettings())
    assert isinstance(source, DemoSource)
    assert len(source.frames) == 3
    problem = source.problem(source.frames[1])
    assert problem.frame == source.frames[1]
    assert source.problem(source.frames[1]) is problem


def test_the_frames_of_a_demo_can_be_named() -> None:
    assert open_scene(demo(frames=["0/2"]), HypothesesSettings()).frames == ("0/2",)


def test_unknown_demos_and_frames_list_what_there_is() -> None:
    with pytest.raises(InputError, match=r"unknown demo scene 'teapot'; available: mug, .*clutter"):
        open_scene(demo(demo="teapot"), HypothesesSettings())
    with pytest.raises(InputError, match=r"unknown frame '1/1'; available: 0/0, 0/1, 0/2 \(demo scene 'clutter'\)"):
        open_scene(demo(frames=["1/1"]), HypothesesSettings())
    with pytest.raises(InputError, match="unknown frame '9/9'; available: 0/0, 0/1, 0/2"):
        open_scene(demo(), HypothesesSettings()).problem("9/9")


def test_a_folder_opens_as_a_data_set(tmp_path: Path) -> None:
    made = make(tmp_path)
    source = open_scene(SceneSettings(source="bop", dataset=str(made.root)), HypothesesSettings())
    assert source.problem(source.frames[0]).frame == made.frame
