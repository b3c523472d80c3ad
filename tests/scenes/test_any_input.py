"""Whatever stands in the files: a problem, or one clear line. Never a traceback."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tests.scenes.bop_folder import Made, detections, make
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.settings import HypothesesSettings
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.detections import DetectionsFile
from verefine_viz.scenes.frames import all_frames
from verefine_viz.scenes.hypothesis_pool import open_results
from verefine_viz.scenes.results_csv import HEADER

numbers = st.one_of(st.integers(-3, 3), st.floats(), st.sampled_from([1e308, -1e308]))
nested = st.recursive(
    st.one_of(st.none(), st.booleans(), numbers, st.text(max_size=3)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=3), inner, max_size=3)),
    max_leaves=6,
)
values = st.one_of(nested, st.just(10**400), st.lists(numbers, max_size=17))

FILES = (
    "scene_camera.json",
    "scene_gt.json",
    "scene_gt_info.json",
    "../../test_targets_bop19.json",
    "../../models/models_info.json",
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make(tmp_path_factory.mktemp("made"))


@pytest.fixture(scope="module")
def found(made: Made) -> list[dict[str, Any]]:
    return detections(made)


steps = st.lists(st.integers(0, 30), max_size=4)


def replaced(content: Any, steps: list[int], new: Any) -> Any:
    """The content with a value somewhere inside replaced: one step down for each number."""
    if not steps or not content or not isinstance(content, dict | list):
        return new
    keys = sorted(content) if isinstance(content, dict) else range(len(content))
    key = keys[steps[0] % len(keys)]
    copy = content.copy()
    copy[key] = replaced(content[key], steps[1:], new)
    return copy


def assert_one_line(error: VerefineError) -> None:
    assert "\n" not in str(error)
    assert len(str(error)) < 800


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(file=st.sampled_from(FILES), new=values, steps=steps)
def test_any_value_anywhere_in_a_json_file(made: Made, file: str, new: Any, steps: list[int]) -> None:
    path = made.scene / file
    before = path.read_text()
    spoilt = json.dumps(replaced(json.loads(before), steps, new))
    try:
        path.write_text(spoilt)
        try:
            dataset = BopDataset(made.root, "test", 50, 0)
            for scene_id, im_id in all_frames(dataset)[0]:
                dataset.image(scene_id, im_id)
                dataset.ground_truth(scene_id, im_id)
            for obj_id in dataset.models.ids:
                dataset.models.get(obj_id)
        except VerefineError as error:
            assert_one_line(error)
    finally:
        path.write_text(before)


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(new=values, steps=steps)
@example(new={"\n": None}, steps=[0])
def test_any_value_anywhere_in_detections(made: Made, found: list[dict[str, Any]], new: Any, steps: list[int]) -> None:
    path = made.root / "any.json"
    path.write_text(json.dumps(replaced(found, steps, new)))
    try:
        masks = [d.mask for d in DetectionsFile(path).of_image(7, 3, (60, 80))[0]]
    except VerefineError as error:
        assert_one_line(error)
    else:
        assert all(mask.shape == (60, 80) for mask in masks)


fields = st.lists(st.text("0123456789.- enaif\r", max_size=12), min_size=6, max_size=8).map(",".join)


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(st.one_of(fields, st.text(max_size=30)), max_size=4).map("\n".join))
@example("1,1,1,1,1e999 0 0 0 1 0 0 0 1,0 0 1,-1")
@example("1,1,1,1,1e308 0 0 0 1e308 0 0 0 1e308,0 0 1,-1")
@example("9" * 5000 + ",1,1,1,1 0 0 0 1 0 0 0 1,0 0 1,-1")
def test_any_text_as_a_results_file(made: Made, text: str) -> None:
    path = made.root / "any_x-test.csv"
    path.write_text(HEADER + "\n" + text, encoding="utf-8", newline="")
    try:
        open_results(path)
    except VerefineError as error:
        assert_one_line(error)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(frame=st.text(max_size=6))
@example("٣/٣")
@example("7/3\n")
def test_any_text_as_a_frame(made: Made, frame: str) -> None:
    try:
        source = made.open(HypothesesSettings(), frames=(frame,))
    except VerefineError as error:
        assert_one_line(error)
    else:
        assert source.frames == ("7/3",)


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    cut=st.floats(0, 1), name=st.sampled_from(["depth/000003.png", "rgb/000003.png", "mask_visib/000003_000001.png"])
)
def test_an_image_cut_off_anywhere(made: Made, cut: float, name: str) -> None:
    path: Path = made.scene / name
    before = path.read_bytes()
    try:
        path.write_bytes(before[: int(cut * len(before))])
        dataset = BopDataset(made.root, "test", 50, 0)
        try:
            dataset.image(7, 3)
            dataset.mask(7, 3, 1, "mask_visib", (60, 80))
        except VerefineError as error:
            assert_one_line(error)
    finally:
        path.write_bytes(before)
