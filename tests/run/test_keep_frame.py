"""Frames that a pipeline kept are read back as they were, and what cannot be right is refused before it is written."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from itertools import count
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from tests.fakes import BOX_M, box_problem
from tests.run.kept_frames import assert_same_files, box_mesh, files_in, found, keep, kept, reopened
from verefine_viz.core.errors import InputError
from verefine_viz.evaluation.ground_truth import BopGroundTruth
from verefine_viz.run.capture_folder import CaptureFolder, captured
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.meshes import read_mesh
from verefine_viz.scenes.models import model_of_mesh


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    return box_mesh(tmp_path / "box.stl")


def test_a_kept_frame_is_the_frame(tmp_path: Path, mesh: Path) -> None:
    problem = box_problem(n_hypotheses=7, n_instances=2)
    objects = [found(problem, mesh, k, with_truth=True) for k in range(2)]
    assert kept(tmp_path / "kept", problem, objects) == "1/1"
    toolbox = reopened(tmp_path / "kept")
    assert toolbox.frames == ("1/1",)
    got = toolbox.problem("1/1")
    np.testing.assert_allclose(got.observation.depth_m, problem.observation.depth_m, atol=0.051e-3)
    np.testing.assert_array_equal(got.observation.camera.K, problem.observation.camera.K)
    np.testing.assert_array_equal(got.observation.rgb, problem.observation.rgb)
    assert [m.name for m in got.models.values()] == ["box"]
    for i, j in zip(got.instances, problem.instances, strict=True):
        np.testing.assert_array_equal(i.mask, j.mask)
        assert i.T_cam_obj_gt is not None
        np.testing.assert_allclose(i.T_cam_obj_gt, j.T_cam_obj_gt, atol=1e-12)
        assert [h.source for h in i.hypotheses] == ["net"] * 7
        poses = np.array([h.T_cam_obj for h in i.hypotheses])
        np.testing.assert_allclose(poses, [h.T_cam_obj for h in j.hypotheses], atol=1e-12)


@pytest.mark.parametrize("known", [0, 1])
def test_ground_truth_of_some_objects_is_kept_for_these(tmp_path: Path, mesh: Path, known: int) -> None:
    problem = box_problem(n_instances=2)
    kept(tmp_path / "kept", problem, [found(problem, mesh, k, with_truth=k == known) for k in range(2)])
    got = reopened(tmp_path / "kept").problem("1/1")
    assert [i.T_cam_obj_gt is not None for i in got.instances] == [k == known for k in range(2)]
    np.testing.assert_allclose(got.instances[known].T_cam_obj_gt, problem.instances[known].T_cam_obj_gt, atol=1e-12)
    assert got.notes == ()
    assert len(BopGroundTruth(BopDataset(tmp_path / "kept", "test")).image(1, 1, with_depth=False).instances) == 1
    assert CaptureFolder(tmp_path / "copy").add(captured(got)) == "1/1"
    copied = reopened(tmp_path / "copy").problem("1/1")
    assert [i.T_cam_obj_gt is not None for i in copied.instances] == [k == known for k in range(2)]


def test_frames_add_up_and_name_their_objects_alike(tmp_path: Path, mesh: Path) -> None:
    problem = box_problem(n_instances=2)
    one, two = found(problem, mesh), found(problem, mesh, 1)
    other = dict(
        two,
        name="carton",
        mesh=box_mesh(tmp_path / "carton.ply"),
        poses={"icp": problem.instances[1].hypotheses[0].T_cam_obj},
    )
    names = [kept(tmp_path / "kept", problem, objects) for objects in ([one], [other, one], [two])]
    assert names == ["1/1", "1/2", "1/3"]
    toolbox = reopened(tmp_path / "kept")
    assert toolbox.frames == ("1/1", "1/2", "1/3")
    first, second, third = (toolbox.problem(frame) for frame in toolbox.frames)
    assert [i.obj_id for i in first.instances] == [1]
    assert {i.obj_id: i.hypotheses[0].source for i in second.instances} == {1: "net", 2: "icp"}
    assert second.models[2].name == "carton"
    np.testing.assert_array_equal(third.instances[0].mask, problem.instances[1].mask)
    assert first.instances[0].T_cam_obj_gt is None
    assert toolbox.run(first).finish().best


@settings(deadline=None, max_examples=20)
@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1), st.floats(0.1, 10))
def test_gravity_is_the_direction_that_was_given(
    tmp_path_factory: pytest.TempPathFactory, direction: tuple[float, float, float], length: float
) -> None:
    folder = tmp_path_factory.mktemp("kept")
    problem = box_problem()
    mesh = box_mesh(folder.parent / f"{folder.name}.ply")
    kept(folder, problem, [found(problem, mesh)], gravity_cam=np.array(direction) * length)
    camera = json.loads((folder / "test" / "000001" / "scene_camera.json").read_text())["1"]
    R_cam_world = np.reshape(camera["cam_R_w2c"], (3, 3))
    np.testing.assert_allclose(R_cam_world.T @ R_cam_world, np.eye(3), atol=1e-12)
    assert np.linalg.det(R_cam_world) > 0
    np.testing.assert_allclose(-R_cam_world[:, 2], np.array(direction) / np.linalg.norm(direction), atol=1e-12)
    assert reopened(folder).session.scene.gravity == "world"


def test_gravity_counts_where_it_was_given(tmp_path: Path, mesh: Path) -> None:
    problem = box_problem()
    table = problem.observation.support
    kept(tmp_path / "kept", problem, [found(problem, mesh)], gravity_cam=-table.T_world_cam[2, :3])
    kept(tmp_path / "kept", problem, [found(problem, mesh)])
    told, seen = (reopened(tmp_path / "kept").problem(frame) for frame in ("1/1", "1/2"))
    assert (told.observation.support.gravity_source, told.notes) == ("world", ())
    assert seen.observation.support.gravity_source == "plane"
    (note,) = seen.notes
    assert note.startswith("gravity is not known in this frame, as in others of its scene: ")


def test_holes_in_the_depth_stay_holes_and_far_depth_fits(tmp_path: Path, mesh: Path) -> None:
    problem = box_problem()
    seen = problem.observation
    depth = np.array(seen.depth_m, np.float64)
    depth[:4] = [[np.nan], [np.inf], [500.0], [30.0]]
    keep(tmp_path / "kept", seen.camera.K, depth, None, [found(problem, mesh)])
    got = reopened(tmp_path / "kept").problem("1/1").observation
    assert not got.depth_m[:3].any()
    np.testing.assert_allclose(got.depth_m[3], 30.0)
    np.testing.assert_allclose(got.depth_m[4:], depth[4:], atol=0.51e-3)
    assert got.rgb is None


def test_millimetres_of_a_mesh_are_said_and_without_poses_they_are_looked_for(tmp_path: Path) -> None:
    problem = box_problem()
    mesh = box_mesh(tmp_path / "box.obj", unit_m=0.001)
    kept(
        tmp_path / "kept", problem, [{"name": "tea", "mesh": mesh, "mask": problem.instances[0].mask, "unit_m": 0.001}]
    )
    toolbox = reopened(tmp_path / "kept")
    assert toolbox.session.hypotheses.source == "ppf"
    model = toolbox.problem("1/1").models[1]
    assert (model.name, model.diameter_m) == ("tea", pytest.approx(np.linalg.norm(BOX_M)))


def test_symmetry_about_an_axis_is_known_when_it_is_opened(tmp_path: Path) -> None:
    problem = box_problem()
    mesh = tmp_path / "moved.ply"
    box = trimesh.creation.cylinder(BOX_M[0] / 2, BOX_M[2], sections=32)
    box.apply_translation([0.05, 0, 0])
    box.export(mesh)
    kept(
        tmp_path / "kept",
        problem,
        [{"name": "can", "mesh": mesh, "mask": problem.instances[0].mask, "symmetry_axis": [0, 0, 2]}],
    )
    model = reopened(tmp_path / "kept").problem("1/1").models[1]
    assert len(model.symmetries) == 64
    for T in model.symmetries:
        np.testing.assert_allclose(T @ [0.05, 0, 0.3, 1], [0.05, 0, 0.3, 1], atol=1e-9)


def _keep_three(folder: Path, mesh: Path) -> None:
    problem = box_problem()
    for _ in range(3):
        kept(folder, problem, [found(problem, mesh)])


@pytest.mark.usefixtures("processes")
def test_two_programs_keep_frames_in_turns(tmp_path: Path, mesh: Path) -> None:
    context = get_context("spawn")
    programs = [context.Process(target=_keep_three, args=(tmp_path / "kept", mesh)) for _ in range(2)]
    for program in programs:
        program.start()
    for program in programs:
        program.join()
    assert [program.exitcode for program in programs] == [0, 0]
    toolbox = reopened(tmp_path / "kept")
    assert toolbox.frames == tuple(f"1/{k}" for k in range(1, 7))
    assert [len(toolbox.problem(frame).instances) for frame in toolbox.frames] == [1] * 6


def killed_at(step: int, monkeypatch: pytest.MonkeyPatch, keep: Callable[[], object]) -> bool:
    """Whether a program was killed while it wrote its file number ``step``, of which a part stays, as it would be."""
    replace_file, n = Path.replace, count(1)

    def replaced(self: Path, target: Path) -> Path:
        if next(n) == step:
            target.with_name(f"{target.name}.1-1.part").write_bytes(self.read_bytes()[:20])
            raise KeyboardInterrupt
        return replace_file(self, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", replaced)
        try:
            keep()
        except KeyboardInterrupt:
            return True
    return False


def test_nothing_of_a_frame_that_was_left_half_written_stays(
    tmp_path: Path, mesh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = box_problem(n_instances=2)
    seen, one, two = problem.observation, found(problem, mesh), found(problem, mesh, 1, with_truth=True)

    def keep_first(folder: Path) -> None:
        kept(folder, problem, [one])

    def keep_next(folder: Path) -> str:
        return keep(folder, seen.camera.K, seen.depth_m, None, [one])

    keep_first(tmp_path / "whole" / "kept")
    before = files_in(tmp_path / "whole" / "kept")
    assert keep_next(tmp_path / "whole" / "kept") == "1/2"
    after = files_in(tmp_path / "whole" / "kept")
    steps = 0
    for step in count(1):
        folder = tmp_path / str(step) / "kept"
        keep_first(folder)
        more = [dict(one, poses={"icp": two["poses"]["net"]}, T_cam_obj_gt=two["T_cam_obj_gt"]), two]
        if not killed_at(step, monkeypatch, lambda folder=folder, more=more: kept(folder, problem, more)):
            break
        steps = step
        assert any(name.endswith(".part") for name in files_in(folder))
        assert reopened(folder).frames == ("1/1",)
        assert [h.source for h in reopened(folder).problem("1/1").instances[0].hypotheses] == ["net"] * 3
        assert files_in(folder)["test/000001/scene_camera.json"] == before["test/000001/scene_camera.json"]
        assert keep_next(folder) == "1/2"
        assert_same_files(files_in(folder), after)
    assert steps > 6


def test_a_first_frame_that_was_left_half_written_is_made_anew(
    tmp_path: Path, mesh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = box_problem()
    wrong = dict(found(problem, box_mesh(tmp_path / "wrong.stl", unit_m=0.9)), name="box")
    n_told = 0
    for step in range(1, 9):
        folder = tmp_path / str(step)
        assert killed_at(step, monkeypatch, lambda folder=folder: kept(folder, problem, [wrong]))
        if (folder / "session.toml").is_file():
            n_told += 1
            for overrides in ({}, {"method": {"name": "refine"}}):
                with pytest.raises(InputError, match=str(folder)):
                    load_session(folder / "session.toml", overrides)
        assert kept(folder, problem, [found(problem, mesh)]) == "1/1"
        toolbox = reopened(folder)
        assert toolbox.frames == ("1/1",)
        assert toolbox.problem("1/1").models[1].diameter_m == pytest.approx(np.linalg.norm(BOX_M))
    assert n_told == 7


def test_a_copy_of_the_session_opens_from_elsewhere(tmp_path: Path, mesh: Path) -> None:
    kept(tmp_path / "kept", box_problem(), [found(box_problem(), mesh)])
    text = (tmp_path / "kept" / "session.toml").read_text().replace('dataset = "."', 'dataset = "kept"')
    copy = tmp_path / "mine.toml"
    copy.write_text(text.replace("detections.json", "kept/detections.json").replace('"net_', '"kept/net_'))
    assert Toolbox(load_session(copy)).frames == ("1/1",)


def test_what_cannot_be_right_is_refused_and_nothing_is_written(tmp_path: Path, mesh: Path) -> None:
    problem = box_problem()
    seen, good = problem.observation, found(problem, mesh)
    T = np.array(problem.instances[0].hypotheses[0].T_cam_obj)
    instance = problem.instances[0]
    in_mm, behind, aside, away = T.copy(), np.diag([1.0, -1, -1, 1]) @ T, T.copy(), T.copy()
    in_mm[:3, 3] *= 1000
    aside[0, 3] = 3.0
    away[2, 3] += 0.3
    shares = np.where(instance.mask, np.linspace(0.5, 1, 80), 0.1)
    cases: list[dict[str, Any]] = [
        {"K": np.eye(4)},
        {"K": np.array(seen.camera.K).T},
        {"depth_m": np.zeros((60, 80))},
        {"depth_m": seen.depth_m * 1000},
        {"depth_m": -seen.depth_m},
        {"rgb": np.zeros((60, 80, 3))},
        {"rgb": np.zeros((30, 80, 3), np.uint8)},
        {"gravity_cam": [0, 0, 0]},
        {"objects": []},
    ]
    objects: list[tuple[dict[str, Any], str]] = [
        ({"mask": np.zeros((60, 80))}, "mask of box"),
        ({"mask": seen.depth_m == 0}, "mask of box has no measured depth"),
        ({"mask": shares}, "mask > 0"),
        ({"mask": ~instance.mask}, "inverted"),
        ({"mesh": tmp_path / "cup.stl"}, "cup"),
        ({"mesh": "cup.step"}, "cup"),
        ({"unit_m": 0}, "unit_m of box"),
        ({"unit_m": 0.001}, "unit_m = "),
        ({"poses": {"../net": T}}, "'../net' of box"),
        ({"poses": {"net": in_mm}}, "in metres"),
        ({"poses": {"net": T * 2}}, "box by net is not rigid"),
        ({"poses": {"net": behind}}, "behind the camera"),
        ({"poses": {"net": aside}}, "is it the inverse"),
        ({"T_cam_obj_gt": away}, "ground-truth pose"),
        ({"symmetry_axis": [0, 0, 0]}, "symmetry_axis of box"),
    ]
    words_of = [(wrong, next(iter(wrong)) if "objects" not in wrong else "object") for wrong in cases]
    words_of += [({"objects": [{**good, **wrong}]}, words) for wrong, words in objects]
    for wrong, words in words_of:
        arguments = {"K": seen.camera.K, "depth_m": seen.depth_m, "rgb": seen.rgb, "objects": [good], **wrong}
        with pytest.raises(InputError, match=re.escape(words)):
            keep(tmp_path / "kept", **arguments)
        assert not (tmp_path / "kept").exists(), words


def test_folders_and_names_of_others_are_left_alone(tmp_path: Path, mesh: Path) -> None:
    problem = box_problem()
    good = found(problem, mesh)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "session.toml").write_text('[scene]\ndemo = "mug"\n')
    with pytest.raises(InputError, match="mine"):
        kept(tmp_path / "mine", problem, [good])
    kept(tmp_path / "kept", problem, [good])
    before = {path: path.read_bytes() for path in (tmp_path / "kept").rglob("*") if path.is_file()}
    trimesh.creation.box(BOX_M * 0.9).export(tmp_path / "other.stl")
    with pytest.raises(InputError, match="box is another mesh"):
        kept(tmp_path / "kept", problem, [dict(good, mesh=tmp_path / "other.stl", name="box")])
    assert {path: path.read_bytes() for path in (tmp_path / "kept").rglob("*") if path.is_file()} == before


# A model that was saved with a frame has the texture that its mesh had.


def textured_mesh(path: Path, colour: tuple[int, int, int]) -> Path:
    """The box with a texture whose left half has another colour than its right one."""
    image = Image.new("RGB", (8, 8), colour)
    image.paste((9, 9, 200), (0, 0, 4, 8))
    bare = trimesh.creation.box(BOX_M)
    bare.unmerge_vertices()
    uv = bare.vertices[:, :2] / BOX_M[:2] + 0.5
    bare.visual = trimesh.visual.TextureVisuals(uv, image=image)
    bare.export(path)
    return path


def test_an_object_keeps_its_texture(tmp_path: Path) -> None:
    problem = box_problem()
    textured = textured_mesh(tmp_path / "box.glb", (200, 9, 9))
    for _ in range(2):
        kept(tmp_path / "kept", problem, [found(problem, textured)])
    before = model_of_mesh(read_mesh(textured, 1.0), 1, "box", 10, 0)
    after = reopened(tmp_path / "kept").problem("1/2").models[1]
    # The order of faces may have changed, their colours where they are may not.
    rng = np.random.default_rng(0)
    weights = rng.dirichlet([1, 1, 1], len(before.faces))
    points = np.einsum("fk,fkj->fj", weights, before.vertices[before.faces])
    mesh = trimesh.Trimesh(after.vertices, after.faces, process=False)
    nearest, _, faces = trimesh.proximity.closest_point(mesh, points)
    np.testing.assert_allclose(nearest, points, atol=1e-9)
    there = trimesh.triangles.points_to_barycentric(after.vertices[after.faces[faces]], points)
    expected = before.colors(np.arange(len(before.faces)), weights)
    np.testing.assert_allclose(after.colors(faces, there), expected, atol=1)
    assert len(np.unique(expected.round(), axis=0)) > 1
    files = files_in(tmp_path / "kept")
    other = found(problem, textured_mesh(tmp_path / "other.glb", (9, 200, 9)))
    with pytest.raises(InputError, match="box is another mesh than before"):
        kept(tmp_path / "kept", problem, [dict(other, name="box")])
    assert_same_files(files_in(tmp_path / "kept"), files)
