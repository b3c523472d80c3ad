"""Folders in the layout of FoundationPose's demo: what is read, what is recognized, and what is imported."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.scenes.test_trace import SHAPE, K, picture, pose, write_box, write_trace
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.run.data_folder import data_at, holds_frames, open_session
from verefine_viz.run.imported_folder import imported
from verefine_viz.scenes.layouts.foundation_pose import Reader
from verefine_viz.scenes.source import open_scene


def write_sequence(folder: Path, n: int = 3, size: float = 0.1) -> Path:
    """``n`` frames of a box at 0.5 m, a mask of the first only, a pose of each."""
    for name in ("rgb", "depth", "masks", "mesh", "ob_in_cam"):
        (folder / name).mkdir(parents=True)
    depth, mask = picture()
    write_box(folder / "mesh" / "textured.obj", size)
    np.savetxt(folder / "cam_K.txt", K)
    for k in range(n):
        name = f"15811204241002621{k:02d}"
        Image.fromarray((depth * 1000).astype(np.uint16)).save(folder / "depth" / f"{name}.png")
        Image.fromarray(np.full((*SHAPE, 3), 90, np.uint8)).save(folder / "rgb" / f"{name}.png")
        np.savetxt(folder / "ob_in_cam" / f"{name}.txt", pose(x=0.002 * k))
    Image.fromarray(mask.astype(np.uint8) * 255).save(folder / "masks" / "1581120424100262100.png")
    return folder


def source_of(folder: Path):
    return open_scene(SceneSettings(source="folder", dataset=str(folder)), HypothesesSettings(source="recorded"))


def test_a_sequence_is_read(tmp_path: Path) -> None:
    source = source_of(write_sequence(tmp_path / "mustard"))
    assert source.frames == ("0/1", "0/2", "0/3")
    first, second = source.problem("0/1"), source.problem("0/2")
    depth, mask = picture()
    assert np.allclose(first.observation.depth_m, depth, atol=1e-6)
    assert np.array_equal(first.instances[0].mask, mask)
    assert not first.notes
    assert np.allclose(second.instances[0].hypotheses[0].T_cam_obj, pose(x=0.002))
    assert first.models[1].name == "mustard"
    (note,) = second.notes
    assert "has no mask; the pixels that its first pose covers" in note
    # The front of the box, drawn at the pose: 0.1 m wide at 0.5 m is 24 pixels.
    assert np.count_nonzero(second.instances[0].mask) == pytest.approx(24 * 24, rel=0.1)


def test_frames_go_by_their_numbers_and_poses_of_a_debug_folder_count(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "mustard", n=4)
    (folder / "depth" / "notes.txt").write_text("")
    for kind, ending in (("rgb", "png"), ("depth", "png"), ("ob_in_cam", "txt")):
        for k, file in enumerate(sorted((folder / kind).glob(f"*.{ending}"))):
            file.rename(file.with_name(f"{8 + k}.{ending}"))
    (folder / "debug").mkdir()
    (folder / "ob_in_cam").rename(folder / "debug" / "ob_in_cam")
    assert Reader(folder).names == ("8", "9", "10", "11")
    source = source_of(folder)
    assert source.frames == ("0/8", "0/9", "0/10", "0/11")
    for k, frame in enumerate(source.frames):
        assert np.allclose(source.problem(frame).instances[0].hypotheses[0].T_cam_obj, pose(x=0.002 * k))


def test_depth_in_metres_and_a_mesh_in_millimetres_are_understood(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "mustard", size=100)
    shutil.copy(folder / "mesh" / "textured.obj", folder / "mesh" / "z.obj")
    depth, _ = picture()
    for file in sorted((folder / "depth").iterdir()):
        file.unlink()
        Image.fromarray(depth).save(file.with_suffix(".tiff"))
    problem = source_of(folder).problem("0/1")
    assert np.allclose(problem.observation.depth_m, depth)
    assert problem.models[1].diameter_m == pytest.approx(0.1 * 3**0.5)
    for words in ("depth in metres", "textured.obj is used, not z.obj"):
        assert any(words in note for note in problem.notes)


def test_a_damaged_file_is_refused_and_a_damaged_pose_noted(tmp_path: Path) -> None:
    name = "1581120424100262100"
    spoils: tuple[tuple[str, Callable[[Path], object]], ...] = (
        ("no mesh", lambda f: shutil.rmtree(f / "mesh")),
        ("80×60", lambda f: Image.new("RGB", (80, 60)).save(f / "rgb" / f"{name}.png")),
        ("3×3", lambda f: (f / "cam_K.txt").write_text("500 0 320")),
    )
    for k, (message, spoil) in enumerate(spoils):
        folder = write_sequence(tmp_path / str(k))
        spoil(folder)
        with pytest.raises(InputError, match=message):
            source_of(folder).problem("0/1")
    folder = write_sequence(tmp_path / "mustard")
    for text in ("1 2 3", "nan " * 16, " ".join(["2"] * 16), "x"):
        (folder / "ob_in_cam" / f"{name}.txt").write_text(text)
        problem = source_of(folder).problem("0/1")
        assert not problem.instances[0].hypotheses
        assert any(f"{name}.txt" in note for note in problem.notes), text


def test_folders_open_with_what_they_hold(tmp_path: Path) -> None:
    """Recorded poses are gone through, or a method starts from them, from the truth or from the images."""
    folder = write_sequence(tmp_path / "mustard")
    write_trace(tmp_path / "runs" / "a_1", write_box(tmp_path / "box.obj"))
    write_trace(tmp_path / "runs" / "a_2", tmp_path / "box.obj")
    for path in (folder, tmp_path / "runs", tmp_path / "runs" / "a_1"):
        assert holds_frames(path)
        for given, method, source in (
            ({}, "trace", "recorded"),
            ({"method": {"name": "rir"}}, "rir", "recorded"),
            ({"hypotheses": {"source": "perturb"}}, "rir", "perturb"),
        ):
            session = open_session(path, given)
            assert (session.method.name, session.hypotheses.source) == (method, source)
        with pytest.raises(SettingsError, match="hypotheses"):
            open_session(path, {"hypotheses": {"source": "ppf"}, "method": {"name": "trace"}})
    assert data_at(tmp_path, {}) is None
    assert not holds_frames(tmp_path)
    (folder / "ob_in_cam").rename(folder / "annotated_poses")
    session = open_session(folder, {})
    assert (session.hypotheses.source, session.method.name) == ("perturb", "rir")
    shutil.rmtree(folder / "annotated_poses")
    assert open_session(folder, {}).hypotheses.source == "ppf"


def test_what_is_imported_opens_as_a_data_set_with_the_same_content(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "mustard")
    assert [*imported(folder, tmp_path / "bop")][1:] == ["0/1 → 1/1", "0/2 → 1/2", "0/3 → 1/3"]
    session = open_session(tmp_path / "bop", {})
    assert session.scene.sequence
    source, before = open_scene(session.scene, session.hypotheses), source_of(folder)
    for frame, old in (("1/1", "0/1"), ("1/3", "0/3")):
        problem, recorded = source.problem(frame), before.problem(old)
        assert np.allclose(problem.observation.depth_m, recorded.observation.depth_m, atol=1e-4)
        assert np.array_equal(problem.instances[0].mask, recorded.instances[0].mask)
        (ours,), (theirs,) = problem.instances[0].hypotheses, recorded.instances[0].hypotheses
        assert np.allclose(ours.T_cam_obj, theirs.T_cam_obj, atol=1e-6)
    for refused in (tmp_path / "bop", folder / "rgb"):
        with pytest.raises(InputError, match="import"):
            [*imported(refused, tmp_path / "again")]


def test_poses_that_are_counted_otherwise_are_paired_in_order(tmp_path: Path) -> None:
    """As YCBInEOAT has them: images are named by their times, ground truth by 0000000, 0000001, …"""
    folder = write_sequence(tmp_path / "mustard")
    (folder / "annotated_poses").mkdir()
    for k in range(3):
        np.savetxt(folder / "annotated_poses" / f"{k:07d}.txt", pose(x=0.01 * k))
    source = source_of(folder)
    assert "paired in order" in source.notes[0]
    for k, frame in enumerate(source.frames):
        assert np.allclose(source.problem(frame).instances[0].T_cam_obj_gt, pose(x=0.01 * k))
    (folder / "annotated_poses" / "0000001.txt").unlink()
    source = source_of(folder)
    assert "left out" in source.notes[0]
    assert source.problem("0/1").instances[0].T_cam_obj_gt is None


def test_poses_may_be_arrays_or_have_three_rows(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "mustard")
    for k, file in enumerate(sorted((folder / "ob_in_cam").iterdir())):
        file.unlink()
        T = pose(x=0.002 * k)
        (np.save if k else np.savetxt)(file.with_suffix(".npy" if k else ".txt"), T[:3] if k < 2 else T[None])
    source = source_of(folder)
    for k, frame in enumerate(source.frames):
        assert np.allclose(source.problem(frame).instances[0].hypotheses[0].T_cam_obj, pose(x=0.002 * k))
