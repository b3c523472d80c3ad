"""One door to data sets and built-in scenes alike."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from tests.scenes.bop_folder import make
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.source import DemoSource, open_scene

pytestmark = pytest.mark.usefixtures("long_run")


def demo(**fields: object) -> SceneSettings:
    return msgspec.convert({"source": "demo", "demo": "clutter", **fields}, SceneSettings)


def test_a_demo_has_a_frame_per_viewpoint_and_each_is_made_once() -> None:
    source = open_scene(demo(), HypothesesSettings())
    assert isinstance(source, DemoSource)
    assert len(source.frames) == 3
    problem = source.problem(source.frames[1])
    assert problem.frame == source.frames[1]
    assert source.problem(source.frames[1]) is problem


def test_the_frames_of_a_demo_can_be_named() -> None:
    assert open_scene(demo(frames=["0/2"]), HypothesesSettings()).frames == ("0/2",)


def test_a_frame_of_a_demo_that_is_named_twice_counts_once_with_a_note() -> None:
    source = open_scene(demo(frames=["0/2", "0/0", "0/2"]), HypothesesSettings())
    assert source.frames == ("0/2", "0/0")
    assert source.notes == ("scene.frames names frame 0/2 more than once; it counts once",)


def test_unknown_demos_and_frames_list_what_there_is() -> None:
    with pytest.raises(InputError, match=r"unknown demo scene 'teapot'; available: mug, .*clutter"):
        open_scene(demo(demo="teapot"), HypothesesSettings())
    with pytest.raises(InputError, match=r"unknown frame '1/1'; available: 0/0, 0/1, 0/2 \(demo scene 'clutter'\)"):
        open_scene(demo(frames=["1/1"]), HypothesesSettings())
    with pytest.raises(InputError, match="unknown frame '9/9'; available: 0/0, 0/1, 0/2"):
        open_scene(demo(), HypothesesSettings()).problem("9/9")


def test_unknown_objects_of_a_demo_are_refused_before_it_is_made() -> None:
    with pytest.raises(SettingsError) as refused:
        open_scene(demo(demo="bowl", objects=[6, 99]), HypothesesSettings())
    said = "unknown object 99 in scene.objects; available: 6 (bowl), 10 (block) (demo scene 'bowl')"
    assert str(refused.value) == said
    assert open_scene(demo(demo="bowl", objects=[6]), HypothesesSettings()).frames == ("0/0",)


def test_a_folder_opens_as_a_data_set(tmp_path: Path) -> None:
    made = make(tmp_path)
    source = open_scene(SceneSettings(source="bop", dataset=str(made.root)), HypothesesSettings())
    assert source.problem(source.frames[0]).frame == made.frame
