"""Variants of known layouts: units, counting, arrays for images, several of a class; Extended APC as published."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from msgspec import structs
from PIL import Image

from tests.scenes.test_layouts import (
    DEPTH,
    MASK,
    problem_at,
    save_depth,
    write_extended_apc,
    write_linemod,
    write_ndds,
    write_pvnet,
    write_ycb_video,
)
from tests.scenes.test_trace import SHAPE, write_box
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.geometry import apply, quat_wxyz
from verefine_viz.observation.dependency_graph import dependency_graph
from verefine_viz.run.data_folder import data_at, open_session
from verefine_viz.run.imported_folder import imported
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.detections import DetectionsFile
from verefine_viz.scenes.layouts.extended_apc import OBJECTS, Reader
from verefine_viz.scenes.source import open_scene


def test_images_of_linemod_that_are_counted_otherwise_are_paired_in_order(tmp_path: Path) -> None:
    write_linemod(tmp_path)
    for kind in ("depth", "rgb", "mask"):
        (tmp_path / "data" / "06" / kind / "0000.png").rename(tmp_path / "data" / "06" / kind / "0001.png")
    session = open_session(tmp_path, {})
    problem = open_scene(session.scene, session.hypotheses).problem("6/1")
    assert problem.instances[0].T_cam_obj_gt is not None
    assert any("counted otherwise than info.yml" in note for note in problem.notes)


def test_models_of_ndds_are_read_in_any_unit_and_as_they_were_published(tmp_path: Path) -> None:
    """The box that frames state decides, so that vertices in the camera frame are the same each time."""
    seen = []
    for k, (unit_m, is_published) in enumerate(((0.01, False), (1.0, False), (0.001, False), (1.0, True))):
        write_ndds(tmp_path / str(k), unit_m, is_published)
        problem = problem_at(tmp_path / str(k) / "frames")
        (instance,) = problem.instances
        vertices = apply(instance.T_cam_obj_gt, problem.models[instance.obj_id].vertices)
        seen.append(np.sort(vertices.round(6), axis=0))
        assert not any("cuboid" in note for note in problem.notes), problem.notes
    assert all(np.allclose(other, seen[0], atol=1e-6) for other in seen[1:])
    mesh = tmp_path / "0" / "models" / "box" / "textured.obj"
    write_box(mesh, 17.0)
    assert any(
        "textured.obj is off the cuboid of 0.173 m" in note for note in problem_at(tmp_path / "0" / "frames").notes
    )


def test_depth_of_ndds_in_8_bits_is_refused_and_16_bits_are_preferred(tmp_path: Path) -> None:
    write_ndds(tmp_path)
    depth = tmp_path / "frames" / "000000.depth.png"
    Image.fromarray(np.full(SHAPE, 200, np.uint8)).save(depth)
    with pytest.raises(VerefineError, match="8 bits"):
        problem_at(depth.parent)
    save_depth(depth.with_name("000000.depth.mm.16.png"), 1000)
    assert np.allclose(problem_at(depth.parent).observation.depth_m, DEPTH, atol=1e-6)


def test_two_of_a_class_of_ndds_share_its_pixels(tmp_path: Path) -> None:
    write_ndds(tmp_path)
    path = tmp_path / "frames" / "000000.json"
    content = json.loads(path.read_text())
    (one,) = content["objects"]
    content["objects"] += [{**one, "location": [one["location"][0] + 4.0, *one["location"][1:]]}]
    path.write_text(json.dumps(content))
    first, second = (instance.mask for instance in problem_at(tmp_path / "frames").instances)
    assert np.array_equal(first | second, MASK)
    assert not (first & second).any()
    assert np.nonzero(first)[1].max() <= np.nonzero(second)[1].min()
    for number, one in zip((7, 70_000), content["objects"], strict=True):
        one["instance_id"] = number
    path.write_text(json.dumps(content))
    upper = MASK & (np.arange(SHAPE[0])[:, None] < 60)
    numbers = upper * 7 + (MASK & ~upper) * 70_000
    colors = np.stack([numbers >> 16, numbers >> 8 & 255, numbers & 255], axis=2).astype(np.uint8)
    Image.fromarray(colors).save(tmp_path / "frames" / "000000.is.png")
    first, second = (instance.mask for instance in problem_at(tmp_path / "frames").instances)
    assert np.array_equal(first, upper)
    assert np.array_equal(second, MASK & ~upper)


def test_the_size_of_a_model_of_pvnet_is_that_of_its_diameter(tmp_path: Path) -> None:
    write_pvnet(tmp_path)
    for diameter, size_m, is_noted in (("0.173", 0.173, False), ("0.00173", 0.00173, False), ("0.9", 0.173, True)):
        (tmp_path / "diameter.txt").write_text(diameter)
        problem = problem_at(tmp_path)
        assert problem.models[1].diameter_m == pytest.approx(size_m, rel=0.01)
        assert any("diameter.txt" in note for note in problem.notes) == is_noted


def test_photos_and_models_may_lie_elsewhere(tmp_path: Path) -> None:
    pvnet, ycb = tmp_path / "pvnet", tmp_path / "ycb"
    write_pvnet(pvnet)
    (pvnet / "JPEGImages").mkdir()
    (pvnet / "rgb" / "7.png").rename(pvnet / "JPEGImages" / "000007.png")
    (pvnet / "rgb").rmdir()
    rgb = problem_at(pvnet).observation.rgb
    assert rgb is not None
    assert (rgb == 90).all()
    write_ycb_video(ycb)
    shutil.move(ycb / "models", ycb / "data" / "0048" / "models")
    assert len(problem_at(ycb / "data" / "0048").instances) == 1


def test_depth_may_be_an_array_in_steps_or_in_metres(tmp_path: Path) -> None:
    for k, (write, image, steps_per_m) in enumerate(
        ((write_linemod, "data/06/depth/0000", 1000), (write_ycb_video, "data/0048/000001-depth", 10_000))
    ):
        for name, array in (("steps", np.round(DEPTH * steps_per_m).astype(np.uint16)), ("metres", DEPTH)):
            folder = tmp_path / f"{k} {name}"
            write(folder)
            (folder / f"{image}.png").unlink()
            np.save(folder / f"{image}.npy", array)
            assert np.abs(problem_at(folder).observation.depth_m - DEPTH).max() < 1e-3, (write, name)


@pytest.fixture
def published(shared_data: Path, tmp_path: Path) -> Path:
    """The frame as the authors have it: depth turned by three bits, all masks in one image, poses of the world."""
    source = shared_data / "xapc"
    dataset = BopDataset(source, "test")
    image, scene = dataset.image(4, 0), tmp_path / "published" / "scene-0004"
    scene.mkdir(parents=True)
    raw = np.array(Image.open(source / "test" / "000004" / "depth" / "000000.png"))
    Image.fromarray((raw.astype(np.uint16) << 3) | (raw.astype(np.uint16) >> 13)).save(scene / "frame-000000.depth.png")
    assert image.rgb is not None
    Image.fromarray(image.rgb).save(scene / "frame-000000.color.png")
    labels = np.zeros(raw.shape, np.uint8)
    for one in DetectionsFile(source / "detections_xapc-test.json").of_image(4, 0, raw.shape)[0]:
        labels[one.mask] = one.obj_id
    Image.fromarray(labels).save(scene / "frame-000000.mask.png")
    T = image.T_map_cam
    info = {
        "camera": {
            "camera_pose": [*T[:3, 3].tolist(), *quat_wxyz(T[:3, :3]).tolist()],
            "camera_intrinsics": image.camera.K.tolist(),
        },
        "rest_surface": {"type": "table", "surface_pose": [0, 0, 0.53, 1, 0, 0, 0]},
        "scene": {"id": 4, "num_objects": 3, "dependency_order": [[1, 2], [3]]}
        | {f"object_{k}": {"name": OBJECTS[obj_id - 1]} for k, obj_id in enumerate((8, 2, 3), 1)},
    }
    (scene / "gt_info.yml").write_text(yaml.safe_dump(info))
    (scene.parent / "models").mkdir()
    for obj_id in (8, 2, 3):
        mesh = dataset.models.get(obj_id)
        lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices] + [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
        (scene.parent / "models" / f"{OBJECTS[obj_id - 1]}.obj").write_text("\n".join(lines))
    return scene.parent


def test_the_published_layout_is_the_frame_in_bop_layout(published: Path, shared_data: Path) -> None:
    problem, image = problem_at(published), BopDataset(shared_data / "xapc", "test").image(4, 0)
    assert np.array_equal(problem.observation.depth_m, image.depth_m)
    assert np.allclose(problem.observation.camera.K, image.camera.K)
    assert [instance.obj_id for instance in problem.instances] == [8, 2, 3]
    assert [int(instance.mask.sum()) for instance in problem.instances] == [31566, 19235, 39756]
    assert np.array_equal(problem.observation.rgb, image.rgb)
    assert np.allclose(problem.observation.support.T_world_cam[2, :3], image.R_world_cam[2], atol=1e-6)
    assert all(instance.T_cam_obj_gt is None for instance in problem.instances), "the sample has no poses"


def test_its_dependency_list_is_the_order_and_the_settings_win(published: Path) -> None:
    known = data_at(published, {})
    problem = problem_at(published)
    graph = dependency_graph(problem, known.session.dependency)
    assert (graph.source, graph.clusters) == ("given", ((0, 1), (2,)))
    other = structs.replace(known.session.dependency, order=((3,), (2, 8)))
    assert dependency_graph(problem, other).clusters == ((2,), (1, 0))
    assert dependency_graph(problem.only([1, 2]), known.session.dependency).clusters == ((1,), (2,))


def test_an_imported_scene_is_bop_with_its_order_and_what_is_down(published: Path, tmp_path: Path) -> None:
    assert [*imported(published, tmp_path / "bop")][1:] == ["4/0 → 1/1"]
    known = data_at(tmp_path / "bop", {})
    problem, first = problem_at(tmp_path / "bop"), problem_at(published)
    assert dependency_graph(problem, known.session.dependency).clusters == ((0, 1), (2,))
    for one, other in zip(problem.instances, first.instances, strict=True):
        assert problem.models[one.obj_id].name == first.models[other.obj_id].name
        assert np.array_equal(one.mask, other.mask)
    ups = [one.observation.support.T_world_cam[2, :3] for one in (problem, first)]
    assert np.allclose(*ups, atol=1e-6)


def test_lists_and_models_of_extended_apc_that_do_not_fit_are_notes(tmp_path: Path) -> None:
    write_extended_apc(tmp_path)
    info = tmp_path / "scene-0004" / "gt_info.yml"
    text = info.read_text()
    for listed in ("[[1], [1]]", "[[2]]", "nothing"):
        info.write_text(text.replace("[[1]]", listed))
        frame = Reader(tmp_path).frame("4/0")
        assert frame.order == ()
        assert any("does not name each object once" in note for note in frame.notes)
    (tmp_path / "models").rename(tmp_path / "_models")
    assert "models/crayola_24_ct/crayola_24_ct.obj" in Reader(tmp_path).notes[0]
    info.write_text(text.replace("object_1", "thing_1"))
    with pytest.raises(InputError, match="object_1"):
        Reader(tmp_path)
