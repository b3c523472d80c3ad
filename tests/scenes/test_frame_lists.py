"""Lists of frames by name: parts of a targets file, and other targets files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.scenes.bop_folder import make
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.run.session_file import resolve
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.frame_lists import FRAME_LISTS, FrameList, linemod_training, listed_frames
from verefine_viz.scenes.source import open_scene

LM_FRAMES = {1: 1236, 2: 1215, 4: 1201, 5: 1196, 6: 1179, 8: 1188, 9: 1254, 10: 1253, 11: 1220, 12: 1237, 13: 1152}
LM_FRAMES |= {14: 1227, 15: 1243}
"""Frames of LINEMOD's scenes, as BB8 (linemod_utils.py) and BOP count them."""


def dataset_of(root: Path, *wanted: tuple[int, int]) -> BopDataset:
    """A made-up data set whose only frame is 1/3, and whose targets file wants these frames."""
    if not root.exists():
        make(root, scene_id=1, targets=False)
    entries = [{"scene_id": s, "im_id": i, "obj_id": 5, "inst_count": 1} for s, i in wanted]
    (root / "test_targets_bop19.json").write_text(json.dumps(entries))
    return BopDataset(root, "test")


def test_the_training_split_of_linemod_is_15_percent_of_each_scene() -> None:
    of_scene = {scene_id: [i for s, i in linemod_training() if s == scene_id] for scene_id in LM_FRAMES}
    assert {s for s, _ in linemod_training()} == LM_FRAMES.keys() == set(FRAME_LISTS["linemod-paper"].scene_ids)
    for scene_id, ids in of_scene.items():
        assert 0 <= min(ids) <= max(ids) < LM_FRAMES[scene_id]
        assert len(ids) / LM_FRAMES[scene_id] == pytest.approx(0.15, abs=0.0025)


def test_linemod_as_the_paper_has_it_leaves_out_two_scenes_and_the_training_frames(tmp_path: Path) -> None:
    training = min(i for s, i in linemod_training() if s == 1)
    dataset = dataset_of(tmp_path / "lm", (1, training), (1, 3), (3, 3), (7, 3))
    assert (1, 3) not in linemod_training()
    frames, notes = listed_frames(dataset, "linemod-paper")
    assert frames == ((1, 3),)
    assert len(notes) == 1
    assert "1 of the 2219 " in notes[0]


def test_a_whole_list_has_no_note_and_one_of_which_nothing_is_here_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(FRAME_LISTS, "small", FrameList((1,), 1))
    dataset = dataset_of(tmp_path / "lm", (1, 3), (2, 3))
    assert listed_frames(dataset, "small") == (((1, 3),), ())
    with pytest.raises(InputError, match="ycbv-keyframes"):
        listed_frames(dataset, "ycbv-keyframes")
    (dataset.folder / "test_targets_bop19.json").rename(dataset.folder / "test_targets_verefine.json")
    dataset = BopDataset(dataset.folder, "test")
    with pytest.raises(InputError, match="no targets file"):
        listed_frames(dataset, "linemod-paper")
    with pytest.raises(SettingsError, match=r"'linemod-paper'.*, test_targets_verefine\.json"):
        listed_frames(dataset, "linemod-papr")


@pytest.mark.parametrize("frames", ["linemod-paper", ["linemod-paper"], ["1/3", "linemod-paper"]])
def test_the_setting_takes_a_name_or_a_list(tmp_path: Path, frames: str | list[str]) -> None:
    dataset_of(tmp_path / "lm", (1, 3), (2, 4))
    made = {"source": "bop", "dataset": str(tmp_path / "lm"), "frames": frames}
    session = resolve({"scene": made})
    source = open_scene(session.scene, session.hypotheses)
    assert source.frames == ("1/3",)
    assert resolve({"scene": made | {"frames": list(session.scene.frames)}}) == session


def test_of_a_list_only_frames_with_a_wanted_object_are_solved(tmp_path: Path) -> None:
    """Frames that are named one by one all stay, and one without the object is an error when it is read."""
    made = make(tmp_path / "lm", scene_id=1)
    dataset_of(made.root, (1, 3), (1, 4))
    for name in ("scene_gt.json", "scene_camera.json"):
        made.edit(name, lambda content: content.update({"4": content["3"]}))
    made.edit("scene_gt.json", lambda content: content["4"].__delitem__(slice(1, 2)))
    assert made.open(frames=("linemod-paper",)).frames == ("1/3",), "1/4 is of the training split"
    every = ("test_targets_bop19.json",)
    assert made.open(frames=every).frames == ("1/3", "1/4")
    assert made.open(frames=every, objects=(5,)).frames == ("1/3",)
    assert made.open(frames=("1/3", "1/4"), objects=(5,)).frames == ("1/3", "1/4")
