"""Folders near the right one, without one of their files, or of kinds that are not read: one line says what to do."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.scenes.test_layouts import (
    problem_at,
    write_deepim,
    write_extended_apc,
    write_foundation_pose,
    write_linemod,
    write_ndds,
    write_ycb_video,
)
from verefine_viz.core.errors import VerefineError
from verefine_viz.run.data_folder import open_session


def refused(path: Path) -> str:
    with pytest.raises(VerefineError) as caught:
        open_session(path, {})
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_is_meant_by_a_folder_around_or_within_is_named(tmp_path: Path) -> None:
    for k, (write, opened, meant) in enumerate(
        (
            (write_deepim, ".", "demo"),
            (write_ycb_video, "data", "."),
            (write_linemod, "data", "."),
            (write_ndds, ".", "frames"),
            (write_ndds, "..", "frames"),
        )
    ):
        folder = tmp_path / str(k) / "it"
        write(folder)
        words = f"is no data set itself; did you mean {(folder / meant).resolve()}?"
        assert words in refused((folder / opened).resolve()), (write, opened)


def test_several_sequences_in_a_folder_are_listed(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_foundation_pose(tmp_path / name)
    assert f"did you mean {tmp_path}/a or {tmp_path}/b?" in refused(tmp_path)


def test_models_of_ycb_video_may_lie_beside_the_images(tmp_path: Path) -> None:
    write_ycb_video(tmp_path)
    shutil.move(tmp_path / "models", tmp_path / "data" / "0048" / "models")
    assert len(problem_at(tmp_path / "data" / "0048").instances) == 1


def test_a_layout_without_one_of_its_files_names_it(tmp_path: Path) -> None:
    for k, (write, folder, missing) in enumerate(
        (
            (write_extended_apc, "scene-0004", "gt_info.yml"),
            (write_linemod, "data/06", "gt.yml"),
            (write_linemod, "data/06", "info.yml"),
            (write_ndds, "frames", "_object_settings.json"),
        )
    ):
        write(tmp_path / str(k))
        (tmp_path / str(k) / folder / missing).unlink()
        assert f"but {missing} is missing: " in refused(tmp_path / str(k) / folder), (write, missing)


def test_a_folder_of_linemod_that_is_not_named_by_its_number_says_so(tmp_path: Path) -> None:
    write_linemod(tmp_path)
    (tmp_path / "data" / "06").rename(tmp_path / "data" / "driller")
    assert "Linemod_preprocessed, but is named otherwise: data/01/" in refused(tmp_path / "data" / "driller")


def test_yaml_is_called_poses_only_where_it_holds_poses(tmp_path: Path) -> None:
    poses = "0:\n  1:\n    2: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]\n"
    for text, is_called in (("title: mug\n", False), (poses, True)):
        (tmp_path / "config.yaml").write_text(text)
        assert ("it holds poses" in refused(tmp_path)) == is_called
    write_linemod(tmp_path / "it")
    file = tmp_path / "it" / "data" / "06" / "info.yml"
    assert refused(file) == f"{file} holds no poses; did you mean its folder, {file.parent}?"


def test_a_file_of_a_known_layout_is_led_to_its_folder(tmp_path: Path) -> None:
    write_ycb_video(tmp_path)
    file = tmp_path / "data" / "0048" / "000001-meta.mat"
    assert refused(file) == f"{file} is no session; did you mean its folder, {file.parent}?"


def clip(folder: Path) -> None:
    for name in ("000000.cameras.json", "000000.objects.json", "000000.image_214-1.jpg"):
        (folder / name).touch()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (clip, "holds HOT3D clips: their cameras are fisheyes without depth"),
        (lambda folder: (folder / "clip-001849.tar").touch(), "holds HOT3D clips"),
        (lambda folder: [(folder / f"00000{end}").touch() for end in ("0.json", "0.seg.exr")], "export with NDDS"),
        (lambda folder: (folder / "0001.exr").touch(), "save the values of each by numpy.save, as 000001.npy"),
    ],
)
def test_folders_that_are_known_and_not_read_say_what_to_do(
    tmp_path: Path, make: Callable[[Path], object], words: str
) -> None:
    make(tmp_path)
    assert words in refused(tmp_path)
