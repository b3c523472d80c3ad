"""``verefine-viz label``: the folders that open, with whose models, and what writes ground truth without the page."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.cli.command_line import CommandLine
from tests.labels.labelled import bare_dataset, label, labels_of, problems
from tests.scenes.bop_folder import Made
from tests.scenes.test_foundation_pose import write_sequence
from tests.scenes.test_layouts import write_sam6d
from tests.scenes.test_trace import K, picture, write_box, write_trace
from verefine_viz import cli
from verefine_viz.core.settings import Session
from verefine_viz.page import app as page_app
from verefine_viz.run.label_session import label_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.labelled_source import LabelledSource
from verefine_viz.scenes.labels import LABELS, write_labels
from verefine_viz.trace import Trace


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    """A folder of meshes that are named as their objects: one in metres, one in millimetres."""
    folder = tmp_path / "meshes"
    folder.mkdir()
    trimesh.creation.box((0.1, 0.06, 0.04)).export(folder / "mug.ply")
    write_box(folder / "jug.obj", 100.0)
    return folder


@pytest.fixture
def line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> CommandLine:
    return CommandLine(tmp_path, Made.__new__(Made), capsys)


def opened(folder: Path, models: Path | None = None) -> LabelledSource:
    source = Toolbox(label_session(folder, models, None, {})).source
    assert isinstance(source, LabelledSource)
    return source


def without(folder: Path, *names: str) -> Path:
    for path in (path for name in names for path in folder.glob(name)):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return folder


def sequence(folder: Path) -> Path:
    write_sequence(folder)
    return folder


def sam6d(folder: Path) -> Path:
    write_sam6d(folder)
    return folder


def bare_trace(folder: Path) -> Path:
    depth_m, _ = picture()
    with Trace(folder, K=K, depth_m=depth_m):
        pass
    return folder


def scene_of(folder: Path) -> Path:
    return bare_dataset(folder, problems(1)) / "test" / "000003"


WITHOUT_OBJECTS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "images and a camera": (lambda f: without(sequence(f), "masks", "mesh", "ob_in_cam"), "0/1"),
    "one image": (lambda f: without(sam6d(f), "*.obj", "outputs"), "0/0"),
    "a trace": (bare_trace, "0/1"),
    "a scene of a split": (scene_of, "3/0"),
    "a split": (lambda f: scene_of(f).parent, "3/0"),
    "a data set without models": (lambda f: without(scene_of(f).parent.parent, "models"), "3/0"),
    "a scene without models": (lambda f: without(scene_of(f), "../../models"), "3/0"),
}


def test_frames_without_objects_open_with_the_meshes_of_a_folder(tmp_path: Path, meshes: Path) -> None:
    for k, (what, (write, first)) in enumerate(WITHOUT_OBJECTS.items()):
        source = opened(write(tmp_path / f"{k} as it came"), meshes)
        assert source.frames[0] == first, what
        assert (source.observation(first).depth_m > 0).any(), what
        assert source.problem(first).instances == (), what
        models = source.bare.models
        assert [models.name(obj_id) for obj_id in models.ids] == ["jug", "mug"], what
        diameters = [models.get(obj_id).diameter_m for obj_id in models.ids]
        np.testing.assert_allclose(diameters, [0.1 * 3**0.5, 0.1233], atol=1e-3, err_msg=what)


def test_models_that_a_recording_names_are_those_of_all_its_frames(tmp_path: Path) -> None:
    bare_trace(tmp_path / "runs" / "a")
    for k, name in enumerate(("b", "c")):
        write_trace(tmp_path / "runs" / name, write_box(tmp_path / f"{name}.obj", 100.0 + 50 * k))
    models = opened(tmp_path / "runs").bare.models
    assert [models.name(obj_id) for obj_id in models.ids] == ["box"]
    assert opened(sequence(tmp_path / "mustard")).bare.models.ids == (1,)


def test_a_mesh_that_is_added_changes_no_label_and_one_that_is_gone_costs_its_own(tmp_path: Path, meshes: Path) -> None:
    folder = scene_of(tmp_path / "boxes")
    T = problems(1)[0].instances[0].T_cam_obj_gt
    assert T is not None
    write_labels(folder / LABELS, {"3/0": (mug := label(0, 2, T, name="mug"), label(1, 1, T, name="jug"))})
    trimesh.creation.box((0.1, 0.1, 0.1)).export(meshes / "bowl.ply")
    source = opened(folder, meshes)
    assert {source.bare.models.name(obj_id): obj_id for obj_id in source.bare.models.ids} == {
        "jug": 1, "mug": 2, "bowl": 3,
    }  # fmt: skip
    assert source.problem("3/0").models[mug.obj_id].name == "mug"
    (meshes / "jug.obj").unlink()
    problem = opened(folder, meshes).problem("3/0")
    assert [one.obj_id for one in problem.instances] == [2]
    assert [(one.instance_id, one.name) for one in problem.left_out] == [(1, "jug")]


def test_the_page_is_opened_on_the_frames(tmp_path: Path, meshes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Session] = []
    monkeypatch.setattr(page_app, "serve", lambda session, **given: asked.append(session))
    folder = scene_of(tmp_path / "boxes")
    assert cli.main(["label", str(folder), "--models", str(meshes), "--method.refiner", "icp"]) == 0
    (session,) = asked
    assert Path(session.scene.labels) == folder.resolve() / LABELS
    assert (session.scene.frames, session.method.refiner) == (("3/0",), "icp")


def test_accepted_labels_are_written_once_or_elsewhere(tmp_path: Path, line: CommandLine) -> None:
    made = problems()
    folder, labels = bare_dataset(tmp_path / "boxes", made), labels_of(made)
    write_labels(folder / LABELS, labels)
    assert cli.main(["label", str(folder), "--write"]) == 0
    assert "4 labels of 2 frames" in line.capsys.readouterr().out
    truth = (folder / "test" / "000003" / "scene_gt.json").read_bytes()
    assert "overwrite" in line.refused("label", folder, "--write")
    assert (folder / "test" / "000003" / "scene_gt.json").read_bytes() == truth
    assert json.loads((folder / LABELS).read_text())["version"] == 1
    assert cli.main(["label", str(folder), "--write", "--to", str(tmp_path / "own")]) == 0
    for root in (folder, tmp_path / "own"):
        entries = BopDataset(root, "test").ground_truth(3, 1)
        assert entries is not None
        for entry, one in zip(entries, labels["3/1"], strict=True):
            assert entry.T_cam_obj is not None
            np.testing.assert_allclose(entry.T_cam_obj, one.pose, atol=1e-9)


def test_what_cannot_be_labelled_or_written_is_one_line(tmp_path: Path, meshes: Path, line: CommandLine) -> None:
    folder = bare_dataset(tmp_path / "boxes", problems(1))
    bare, nothing = without(sequence(tmp_path / "seq"), "mesh"), tmp_path / "nothing"
    nothing.mkdir()
    write_labels(bare / LABELS, {"0/1": (label(0, 1, np.eye(4)),)})
    refused: tuple[tuple[object, tuple[Any, ...]], ...] = (
        (tmp_path / "missing", (tmp_path / "missing",)),
        (nothing, (nothing,)),
        (nothing, (folder, "--models", nothing)),
        (meshes / "mug.ply", (folder, "--models", meshes / "mug.ply")),
        ("--write", (folder, "--to", tmp_path / "new")),
        ("label", (folder, "--write")),
        ("--models FOLDER", (bare,)),
        ("--models FOLDER", (without(scene_of(tmp_path / "own"), "../../models"),)),
        ("--to FOLDER", (bare, "--models", meshes, "--write")),
    )
    before = {*tmp_path.rglob("*")}
    for named, words in refused:
        assert str(named) in line.refused("label", *words, "--port", "0", "--no-open-browser", leaves=("boxes", "seq"))
    assert {path.name for path in {*tmp_path.rglob("*")} - before} <= {".labels.lock"}
