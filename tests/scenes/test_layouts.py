"""Folders as other programs have them: each is recognized, opened, and read as what was written."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from PIL import Image

from tests.scenes.test_foundation_pose import write_sequence
from tests.scenes.test_trace import SHAPE, K, picture, pose, write_box
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.geometry import quat_wxyz
from verefine_viz.core.problem import ANSWER
from verefine_viz.run.data_folder import data_at, open_session
from verefine_viz.scenes.detections import encode_rle
from verefine_viz.scenes.layouts import readers, traces
from verefine_viz.scenes.source import open_scene

DEPTH, MASK = picture()
ANSWERED, TRUTH = pose(4.0, 0.003), pose()
ORIGINAL, ERASER = "006_mustard_bottle", "expo_dry_erase_board_eraser"


def save_depth(path: Path, steps_per_m: float) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray((DEPTH * steps_per_m).astype(np.uint16)).save(path)


def save_color(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((*SHAPE, 3), 90, np.uint8)).save(path)


def yml_of(R_mm: np.ndarray) -> str:
    """An entry of gt.yml as LINEMOD has it."""
    numbers = [", ".join(map(str, part.ravel())) for part in (R_mm[:3, :3], R_mm[:3, 3] * 1000)]
    return f"0:\n- cam_R_m2c: [{numbers[0]}]\n  cam_t_m2c: [{numbers[1]}]\n  obj_bb: [1, 2, 3, 4]\n  obj_id: 6\n"


def write_sam6d(folder: Path) -> None:
    folder.mkdir(parents=True)
    save_depth(folder / "depth.png", 1000)
    save_color(folder / "rgb.png")
    write_box(folder / "obj_000006.ply.obj").rename(folder / "obj_000006.obj")
    (folder / "camera.json").write_text(json.dumps({"cam_K": K.ravel().tolist(), "depth_scale": 1.0}))
    found = []
    for score, T in ((0.2, TRUTH), (0.9, ANSWERED)):
        of_mask = {"segmentation": encode_rle(MASK), "bbox": [69, 49, 22, 22], "time": 0.1}
        found.append({**of_mask, "score": score, "R": T[:3, :3].tolist(), "t": (T[:3, 3] * 1000).tolist()})
    (folder / "outputs" / "sam6d_results").mkdir(parents=True)
    (folder / "outputs" / "sam6d_results" / "detection_pem.json").write_text(json.dumps(found))


def write_megapose(folder: Path) -> None:
    for name in ("inputs", "outputs", "meshes/box"):
        (folder / name).mkdir(parents=True)
    save_depth(folder / "image_depth.png", 1000)
    save_color(folder / "image_rgb.png")
    write_box(folder / "meshes" / "box" / "hope_000002.obj")
    (folder / "camera_data.json").write_text(json.dumps({"K": K.tolist(), "resolution": SHAPE}))
    box = [{"label": "box", "bbox_modal": [69, 49, 90, 70]}]
    (folder / "inputs" / "object_data.json").write_text(json.dumps(box))
    w, x, y, z = quat_wxyz(ANSWERED[:3, :3]).tolist()
    answered = [{"label": "box", "TWO": [[x, y, z, w], ANSWERED[:3, 3].tolist()]}]
    (folder / "outputs" / "object_data.json").write_text(json.dumps(answered))


def write_linemod(folder: Path) -> None:
    scene = folder / "data" / "06"
    save_depth(scene / "depth" / "0000.png", 1000)
    save_color(scene / "rgb" / "0000.png")
    (scene / "mask").mkdir()
    Image.fromarray(np.repeat(MASK[..., None], 3, 2).astype(np.uint8) * 255).save(scene / "mask" / "0000.png")
    (scene / "gt.yml").write_text(yml_of(TRUTH))
    numbers = ", ".join(map(str, K.ravel()))
    (scene / "info.yml").write_text(f"0:\n  cam_K: [{numbers}]\n  depth_scale: 1.0\n")
    (folder / "models").mkdir()
    write_box(folder / "models" / "obj_06.obj").rename(folder / "models" / "obj_06.ply.obj")
    import trimesh

    trimesh.load(folder / "models" / "obj_06.ply.obj").export(folder / "models" / "obj_06.ply")


def write_ycb_video(folder: Path) -> None:
    stem = folder / "data" / "0048"
    save_depth(stem / "000001-depth.png", 10_000)
    save_color(stem / "000001-color.png")
    Image.fromarray(MASK.astype(np.uint8) * 5).save(stem / "000001-label.png")
    meta = {"intrinsic_matrix": K, "factor_depth": np.array([[10_000]], np.uint16), "vertmap": np.zeros(3)}
    meta |= {"cls_indexes": np.array([[5]], np.uint8), "poses": TRUTH[:3]}
    scipy.io.savemat(stem / "000001-meta.mat", meta)
    (folder / "models" / ORIGINAL).mkdir(parents=True)
    write_box(folder / "models" / ORIGINAL / "textured.obj", 0.1)


def write_deepim(folder: Path) -> None:
    save_depth(folder / "demo" / "000000-depth.png", 1000)
    save_color(folder / "demo" / "000000-color.png")
    (folder / "demo" / "meta.yml").write_text(f"INTRINSICS: {K.ravel().tolist()}\n")
    first, second = pose(20.0, 0.01), ANSWERED
    rows = [[*quat_wxyz(T[:3, :3]), *T[:3, 3]] for T in (first, first, second)]
    rois = np.array([[0, 5, 69, 49, 90, 70, 0.8]], np.float32)
    posecnn = {"labels": MASK.astype(np.int32) * 5, "rois": rois, "poses": np.array(rows[:1], np.float32)}
    deepim = {"poses_est": np.array([[[0, 4, *row]] for row in rows[1:]], np.float32)}
    for name, arrays in (("posecnn_results", posecnn), ("deepim_results_RGBD", deepim)):
        (folder / "demo" / name).mkdir()
        scipy.io.savemat(folder / "demo" / name / "000000-color.png.mat", arrays)
    (folder / "YCB_Video" / "models" / ORIGINAL).mkdir(parents=True)
    write_box(folder / "YCB_Video" / "models" / ORIGINAL / "textured_simple.obj", 0.1)


def write_extended_apc(folder: Path) -> None:
    """A world whose z is up and whose origin is not the camera's; the eraser is object 2."""
    T_world_cam = pose(120.0, 0.3)
    scene = folder / "scene-0004"
    scene.mkdir(parents=True)
    tenths = np.round(DEPTH * 1e4).astype(np.uint16)
    Image.fromarray(tenths << 3 | tenths >> 13).save(scene / "frame-000000.depth.png")
    Image.fromarray(np.full((*SHAPE, 3), 90, np.uint8)).save(scene / "frame-000000.color.png")
    Image.fromarray(MASK.astype(np.uint8) * 2).save(scene / "frame-000000.mask.png")
    poses = [[*T[:3, 3].tolist(), *quat_wxyz(T[:3, :3]).tolist()] for T in (T_world_cam, T_world_cam @ TRUTH)]
    (scene / "gt_info.yml").write_text(
        f"camera:\n  camera_pose: {poses[0]}\n  camera_intrinsics: {K.tolist()}\n"
        "rest_surface:\n  type: table\n  surface_pose: [0, 0, 0.53, 1, 0, 0, 0]\n"
        "scene:\n  id: 4\n  num_objects: 1\n  dependency_order: [[1]]\n"
        f"  object_1:\n    name: '{ERASER}'\n    pose: {poses[1]}\n"
    )
    (folder / "models" / ERASER).mkdir(parents=True)
    write_box(folder / "models" / ERASER / f"{ERASER}.obj", 0.1)


def write_foundation_pose(folder: Path) -> None:
    write_sequence(folder, 1)
    (file,) = (folder / "ob_in_cam").iterdir()
    np.savetxt(file, ANSWERED)


@dataclass(frozen=True)
class Case:
    """A layout, and what is to be read from it."""

    write: Callable[[Path], None]
    what: str
    frame: str
    obj_id: int
    name: str
    opened: str = "."
    """Folder that is opened."""
    n_steps: int = 0
    """Recorded; 0 = it holds ground truth and no poses."""


CASES = (
    Case(write_sam6d, "layout of SAM-6D's example, 1 frame", "0/0", 1, "obj_000006", n_steps=1),
    Case(write_megapose, "layout of MegaPose's example, 1 frame", "0/0", 1, "box", n_steps=1),
    Case(write_linemod, "layout of DenseFusion's Linemod_preprocessed, 1 frame", "6/0", 6, "obj_06"),
    Case(write_linemod, "layout of DenseFusion's Linemod_preprocessed, 1 frame", "6/0", 6, "obj_06", "data/06"),
    Case(write_ycb_video, "layout of YCB-Video, 1 frame", "48/1", 5, ORIGINAL),
    Case(write_ycb_video, "layout of YCB-Video, 1 frame", "48/1", 5, ORIGINAL, "data/0048"),
    Case(write_extended_apc, "layout of Extended APC, 1 frame", "4/0", 2, ERASER),
    Case(write_extended_apc, "layout of Extended APC, 1 frame", "4/0", 2, ERASER, "scene-0004"),
    Case(write_deepim, "layout of DeepIM's demo, 1 frame", "0/0", 5, ORIGINAL, "demo", n_steps=2),
    Case(write_foundation_pose, "layout of FoundationPose's demo, 1 frame", "0/1", 1, "it", n_steps=1),
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.write.__name__}-{case.opened}")
def test_a_layout_is_recognized_and_read(case: Case, tmp_path: Path) -> None:
    case.write(tmp_path / "it")
    known = data_at(tmp_path / "it" / case.opened, {})
    assert known.what == case.what
    source = open_scene(known.session.scene, known.session.hypotheses)
    assert source.frames == (case.frame,)
    problem = source.problem(case.frame)
    observation, (instance,) = problem.observation, problem.instances
    assert np.allclose(observation.camera.K, K)
    assert np.allclose(observation.depth_m, DEPTH, atol=1e-6)
    assert observation.rgb.shape == (*SHAPE, 3)
    model = problem.models[instance.obj_id]
    assert (instance.obj_id, model.name) == (case.obj_id, case.name)
    assert model.diameter_m == pytest.approx(0.1 * 3**0.5, rel=1e-6)
    if case.n_steps:
        assert known.session.method.name == "trace"
        assert len(instance.recorded) == case.n_steps
        assert instance.recorded[-1].name == ANSWER
        assert np.allclose(instance.recorded[-1].T_cam_obj, ANSWERED, atol=1e-6)
    else:
        assert instance.T_cam_obj_gt is not None
        assert np.allclose(instance.T_cam_obj_gt, TRUTH, atol=1e-6)
        assert known.session.hypotheses.source == "perturb"
        assert instance.hypotheses
    if case.write is not write_megapose:  # It has no masks: the pose's own pixels count.
        assert np.array_equal(instance.mask, MASK)


def test_a_colour_image_that_cannot_be_read_costs_its_colours_only(tmp_path: Path) -> None:
    for k, case in enumerate(CASES):
        case.write(tmp_path / str(k))
        (image,) = (p for p in (tmp_path / str(k)).rglob("*.png") if "rgb" in str(p) or "color" in p.name)
        image.write_bytes(image.read_bytes()[:60])
        known = data_at(tmp_path / str(k) / case.opened, {})
        source = open_scene(known.session.scene, known.session.hypotheses)
        problem = source.problem(case.frame)
        assert len(problem.instances) == 1, case
        said = [note for note in problem.notes if "drawn without colour" in note]
        assert len(said) == 1, (case, problem.notes)
        assert str(image) in said[0]
        assert "fetch it again" in said[0]


def test_each_folder_has_one_layout_and_each_layout_a_case(tmp_path: Path) -> None:
    seen = {traces.Reader}  # tests/scenes/test_trace.py
    for k, case in enumerate(CASES):
        case.write(tmp_path / str(k))
        (own,) = (reader for reader in readers() if reader.recognizes(tmp_path / str(k) / case.opened))
        seen.add(own)
    assert seen == {*readers()}


def test_what_is_damaged_in_a_layout_is_one_line(tmp_path: Path) -> None:
    """Each file of each layout is emptied, cut, and replaced by text: the frame opens or one line says why not."""
    messages: list[str] = []
    for k, case in enumerate(CASES):
        folder = tmp_path / str(k)
        case.write(folder)
        for path in sorted(p for p in folder.rglob("*") if p.is_file()):
            whole = path.read_bytes()
            for damaged in (b"", whole[: len(whole) // 2], b"[1, 2]\n", None):
                path.unlink()
                if damaged is not None:
                    path.write_bytes(damaged)
                try:
                    known = data_at(folder / case.opened, {})
                    if known is not None:
                        source = open_scene(known.session.scene, known.session.hypotheses)
                        source.problem(source.frames[0])
                except VerefineError as error:
                    messages.append(str(error))
                path.write_bytes(whole)
    assert len(messages) > 50
    assert not any("\n" in message for message in messages)


def test_what_lacks_one_file_says_which(tmp_path: Path) -> None:
    for k, (write, name) in enumerate(((write_sam6d, "depth.png"), (write_megapose, "camera_data.json"))):
        folder = tmp_path / str(k)
        write(folder)
        (folder / name).unlink()
        with pytest.raises(VerefineError, match=f"looks like the layout of .*, but {name} is missing"):
            open_session(folder, {})


def test_images_of_linemod_that_are_counted_otherwise_are_paired_in_order(tmp_path: Path) -> None:
    write_linemod(tmp_path)
    for kind in ("depth", "rgb", "mask"):
        (tmp_path / "data" / "06" / kind / "0000.png").rename(tmp_path / "data" / "06" / kind / "0001.png")
    session = open_session(tmp_path, {})
    problem = open_scene(session.scene, session.hypotheses).problem("6/1")
    assert problem.instances[0].T_cam_obj_gt is not None
    assert any("counted otherwise than info.yml" in note for note in problem.notes)
