"""Extended APC as its authors publish it, written from the frame in BOP layout that came with their code."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from msgspec import structs
from PIL import Image

from tests.scenes.test_layouts import write_extended_apc
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import quat_wxyz
from verefine_viz.observation.dependency_graph import dependency_graph
from verefine_viz.run.data_folder import data_at
from verefine_viz.run.imported_folder import imported
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.detections import DetectionsFile
from verefine_viz.scenes.layouts.extended_apc import OBJECTS, Reader
from verefine_viz.scenes.source import SceneSource, open_scene


def opened(folder: Path) -> SceneSource:
    known = data_at(folder, {})
    return open_scene(known.session.scene, known.session.hypotheses)


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
    problem, image = opened(published).problem("4/0"), BopDataset(shared_data / "xapc", "test").image(4, 0)
    assert np.array_equal(problem.observation.depth_m, image.depth_m)
    assert np.allclose(problem.observation.camera.K, image.camera.K)
    assert [instance.obj_id for instance in problem.instances] == [8, 2, 3]
    assert [int(instance.mask.sum()) for instance in problem.instances] == [31566, 19235, 39756]
    assert np.array_equal(problem.observation.rgb, image.rgb)
    assert np.allclose(problem.observation.support.T_world_cam[2, :3], image.R_world_cam[2], atol=1e-6)
    assert all(instance.T_cam_obj_gt is None for instance in problem.instances), "the sample has no poses"


def test_its_dependency_list_is_the_order_and_the_settings_win(published: Path) -> None:
    known = data_at(published, {})
    problem = opened(published).problem("4/0")
    graph = dependency_graph(problem, known.session.dependency)
    assert (graph.source, graph.clusters) == ("given", ((0, 1), (2,)))
    other = structs.replace(known.session.dependency, order=((3,), (2, 8)))
    assert dependency_graph(problem, other).clusters == ((2,), (1, 0))
    assert dependency_graph(problem.only([1, 2]), known.session.dependency).clusters == ((1,), (2,))


def test_an_imported_scene_is_bop_with_its_order_and_what_is_down(published: Path, tmp_path: Path) -> None:
    assert [*imported(published, tmp_path / "bop")][1:] == ["4/0 → 1/1"]
    known = data_at(tmp_path / "bop", {})
    problem, first = opened(tmp_path / "bop").problem("1/1"), opened(published).problem("4/0")
    assert dependency_graph(problem, known.session.dependency).clusters == ((0, 1), (2,))
    for one, other in zip(problem.instances, first.instances, strict=True):
        assert problem.models[one.obj_id].name == first.models[other.obj_id].name
        assert np.array_equal(one.mask, other.mask)
    ups = [one.observation.support.T_world_cam[2, :3] for one in (problem, first)]
    assert np.allclose(*ups, atol=1e-6)


@pytest.mark.parametrize("listed", ["[[1], [1]]", "[[2]]", "nothing"])
def test_a_dependency_list_that_does_not_fit_is_a_note(tmp_path: Path, listed: str) -> None:
    write_extended_apc(tmp_path)
    info = tmp_path / "scene-0004" / "gt_info.yml"
    info.write_text(info.read_text().replace("[[1]]", listed))
    frame = Reader(tmp_path).frame("4/0")
    assert frame.order == ()
    assert [note for note in frame.notes if "does not name each object once" in note]


def test_scenes_without_an_object_and_models_that_are_missing_are_named(tmp_path: Path) -> None:
    write_extended_apc(tmp_path)
    (tmp_path / "models").rename(tmp_path / "_models")
    assert "has no models; expected models/crayola_24_ct/crayola_24_ct.obj" in Reader(tmp_path).notes[0]
    info = tmp_path / "scene-0004" / "gt_info.yml"
    info.write_text(info.read_text().replace("object_1", "thing_1"))
    with pytest.raises(InputError, match=r"gt_info.yml names no object; expected scene: object_1"):
        Reader(tmp_path)
