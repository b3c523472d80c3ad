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

from tests.scenes.bop_folder import cut
from tests.scenes.test_foundation_pose import write_sequence
from tests.scenes.test_trace import SHAPE, K, picture, pose, write_box
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.geometry import quat_wxyz
from verefine_viz.core.problem import ANSWER, Problem
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


def write_ndds(folder: Path, model_m: float = 0.01, is_published: bool = False) -> None:
    """A frame of NDDS: centimetres, quaternions xyzw, the model aligned by NVDU [cm] or as it was published [m]."""
    scene = folder / "frames"
    save_depth(scene / "000000.depth.png", 10_000)
    save_color(scene / "000000.png")
    Image.fromarray(MASK.astype(np.uint8) * 12).save(scene / "000000.seg.png")
    camera = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "s": 0, "resX": 160, "resY": 120}
    cameras = {"camera_settings": [{"name": "left", "intrinsic_settings": camera}]}
    (scene / "_camera_settings.json").write_text(json.dumps(cameras))
    fixed = np.array([[0, 0, 100, 0], [-100, 0, 0, 0], [0, -100, 0, 0], [7.0, -2.0, 3.0, 1]])
    exported = {"class": "box_16k", "segmentation_class_id": 12, "fixed_model_transform": fixed.tolist()}
    (scene / "_object_settings.json").write_text(json.dumps({"exported_objects": [exported]}))
    w, x, y, z = quat_wxyz(TRUTH[:3, :3]).tolist()
    corners = np.array([[x, y, z] for x in (-5, 5) for y in (-5, 5) for z in (-5, 5)], np.float64)
    one = {"class": "box_16k", "location": (TRUTH[:3, 3] * 100).tolist(), "quaternion_xyzw": [x, y, z, w]}
    one["cuboid"] = (corners @ TRUTH[:3, :3].T + TRUTH[:3, 3] * 100).tolist()
    (scene / "000000.json").write_text(json.dumps({"camera_data": {}, "objects": [one]}))
    (folder / "models" / "box").mkdir(parents=True)
    mesh = write_box(folder / "models" / "box" / "textured.obj", 0.1 / model_m)
    if is_published:  # What the transform takes to the aligned model.
        lines = [line.split() for line in mesh.read_text().splitlines()]
        vertices = np.array([line[1:] for line in lines if line[0] == "v"], np.float64) * (model_m * 100)
        moved = (vertices - fixed[3, :3]) @ fixed[:3, :3].T / 1e4
        texts = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in moved]
        mesh.write_text("\n".join([*texts, *(" ".join(line) for line in lines if line[0] == "f")]))


def write_pvnet(folder: Path) -> None:
    save_depth(folder / "depth" / "7.png", 1000)
    save_color(folder / "rgb" / "7.png")
    for name in ("mask", "pose"):
        (folder / name).mkdir()
    Image.fromarray(MASK.astype(np.uint8) * 255).save(folder / "mask" / "7.png")
    np.save(folder / "pose" / "pose7.npy", TRUTH[:3])
    np.savetxt(folder / "camera.txt", K)
    (folder / "diameter.txt").write_text("0.173\n")
    import trimesh

    trimesh.load(write_box(folder / "box.obj", 0.1)).export(folder / "model.ply")
    (folder / "box.obj").unlink()


def write_foundation_pose(folder: Path) -> None:
    write_sequence(folder, 1)
    (file,) = (folder / "ob_in_cam").iterdir()
    np.savetxt(file, ANSWERED)


@dataclass(frozen=True)
class Case:
    """A layout, and what is to be read from it."""

    write: Callable[[Path], None]
    frame: str
    obj_id: int
    name: str
    opened: str = "."
    """Folder that is opened."""
    n_steps: int = 0
    """Recorded; 0 = it holds ground truth and no poses."""


CASES = (
    Case(write_sam6d, "0/0", 1, "obj_000006", n_steps=1),
    Case(write_megapose, "0/0", 1, "box", n_steps=1),
    Case(write_linemod, "6/0", 6, "obj_06"),
    Case(write_linemod, "6/0", 6, "obj_06", "data/06"),
    Case(write_ycb_video, "48/1", 5, ORIGINAL),
    Case(write_ycb_video, "48/1", 5, ORIGINAL, "data/0048"),
    Case(write_extended_apc, "4/0", 2, ERASER),
    Case(write_extended_apc, "4/0", 2, ERASER, "scene-0004"),
    Case(write_deepim, "0/0", 5, ORIGINAL, "demo", n_steps=2),
    Case(write_ndds, "0/0", 1, "box_16k", "frames"),
    Case(write_pvnet, "0/7", 1, "it"),
    Case(write_foundation_pose, "0/1", 1, "it", n_steps=1),
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.write.__name__}-{case.opened}")
def test_a_layout_is_recognized_and_read(case: Case, tmp_path: Path) -> None:
    case.write(tmp_path / "it")
    known = data_at(tmp_path / "it" / case.opened, {})
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


def problem_at(folder: Path) -> Problem:
    session = open_session(folder, {})
    source = open_scene(session.scene, session.hypotheses)
    return source.problem(source.frames[0])


def test_a_colour_image_that_cannot_be_read_costs_its_colours_only(tmp_path: Path) -> None:
    for k, case in enumerate(CASES):
        folder = tmp_path / str(k)
        case.write(folder)
        images = [p for p in folder.rglob("*.png") if "rgb" in str(p) or "color" in p.name]
        (image,) = images or folder.rglob("000000.png")
        cut(image)
        problem = problem_at(folder / case.opened)
        assert len(problem.instances) == 1, case
        assert problem.observation.rgb is None, case
        assert sum(str(image) in note for note in problem.notes) == 1, (case, problem.notes)


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


def refused(path: Path) -> str:
    with pytest.raises(VerefineError) as caught:
        open_session(path, {})
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_layout_without_one_of_its_files_names_it(tmp_path: Path) -> None:
    for k, (write, folder, missing) in enumerate(
        (
            (write_sam6d, ".", "depth.png"),
            (write_megapose, ".", "camera_data.json"),
            (write_foundation_pose, ".", "cam_K.txt"),
            (write_extended_apc, "scene-0004", "gt_info.yml"),
            (write_linemod, "data/06", "gt.yml"),
            (write_linemod, "data/06", "info.yml"),
            (write_ndds, "frames", "_object_settings.json"),
        )
    ):
        write(tmp_path / str(k))
        (tmp_path / str(k) / folder / missing).unlink()
        assert f"but {missing} is missing" in refused(tmp_path / str(k) / folder), (write, missing)
    for write, part in ((write_ndds, "frames"), (write_pvnet, ".")):
        folder = tmp_path / write.__name__
        write(folder)
        for path in [*folder.rglob("*depth.png"), *folder.rglob("depth/*")]:
            path.unlink()
        assert "depth" in refused(folder / part)


def test_what_is_meant_by_a_folder_around_or_within_is_named(tmp_path: Path) -> None:
    for k, (write, opened, meant) in enumerate(
        (
            (write_deepim, ".", "demo"),
            (write_ycb_video, "data", "."),
            (write_linemod, "data", "."),
            (write_ndds, ".", "frames"),
            (write_ndds, "..", "frames"),
            (write_ycb_video, "data/0048/000001-meta.mat", "data/0048"),
            (write_linemod, "data/06/info.yml", "data/06"),
        )
    ):
        folder = tmp_path / str(k) / "it"
        write(folder)
        assert f" {(folder / meant).resolve()}?" in refused((folder / opened).resolve()), (write, opened)
    for name in ("a", "b"):
        write_sequence(tmp_path / "two" / name, 1)
    assert f"{tmp_path}/two/a or {tmp_path}/two/b?" in refused(tmp_path / "two")
    write_linemod(tmp_path / "linemod")
    (tmp_path / "linemod" / "data" / "06").rename(tmp_path / "linemod" / "data" / "driller")
    assert "data/01/" in refused(tmp_path / "linemod" / "data" / "driller")


def test_yaml_is_called_poses_only_where_it_holds_poses(tmp_path: Path) -> None:
    poses = "0:\n  1:\n    2: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]\n"
    for text, is_called in (("title: mug\n", False), (poses, True)):
        (tmp_path / "config.yaml").write_text(text)
        assert ("it holds poses" in refused(tmp_path)) == is_called


def test_folders_that_are_known_and_not_read_say_what_to_do(tmp_path: Path) -> None:
    hot3d = ("000000.cameras.json", "000000.objects.json", "000000.image_214-1.jpg")
    for k, (names, words) in enumerate(
        (
            (hot3d, "HOT3D"),
            (("clip-001849.tar",), "HOT3D"),
            (("000000.json", "000000.seg.exr"), "NDDS"),
            (("0001.exr",), "numpy.save"),
            ((), "holds no data"),
        )
    ):
        folder = tmp_path / str(k)
        folder.mkdir()
        for name in names:
            (folder / name).touch()
        assert words in refused(folder)
