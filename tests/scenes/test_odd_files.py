"""A pipe, a device, a loop of links or a folder in place of a file of a data set is one clear line, and no hang."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from verefine_viz.core.files import read_json

from tests.scenes.bop_folder import box_ply, make, refusal
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import HypothesesSettings
from verefine_viz.evaluation.results_scores import evaluate_files
from verefine_viz.observation.given_order import read_orders
from verefine_viz.scenes.image_files import find_image, read_mask
from verefine_viz.scenes.meshes import read_mesh
from verefine_viz.scenes.results_csv import read_results

KINDS: dict[str, tuple[Callable[[Path], object], str]] = {
    "pipe": (os.mkfifo, "is a pipe, expected a file"),
    "device": (lambda path: path.symlink_to("/dev/zero"), "is a device, expected a file"),
    "loop": (lambda path: path.symlink_to(path.name), "cannot be read: Too many levels of symbolic links"),
    "folder": (Path.mkdir, "is a folder, expected a file"),
}
FILES = (
    "depth/000003.png",
    "rgb/000003.png",
    "scene_camera.json",
    "scene_gt.json",
    "scene_gt_info.json",
    "../../models/models_info.json",
    "../../models/obj_names.json",
    "../../test_targets_bop19.json",
)


def put(path: Path, kind: str) -> str:
    """Puts something else in place of a file; the words that are said about it."""
    if path.is_dir():
        path.rmdir()
    path.unlink(missing_ok=True)
    make_it, words = KINDS[kind]
    make_it(path)
    return f"{path.name} {words}"


def test_what_is_no_file_stops_its_frame(tmp_path: Path) -> None:
    for n, file in enumerate(FILES):
        made = make(tmp_path / str(n))
        for kind in KINDS if n == 0 else ["pipe"]:
            words = put(made.scene / file, kind)
            assert words in refusal(made), (file, kind)


@pytest.mark.parametrize("file", ["mask_visib/000003_000001.png", "../../models/obj_000005.ply"])
def test_what_is_no_file_leaves_out_its_object(tmp_path: Path, file: str) -> None:
    made = make(tmp_path)
    for kind in KINDS:
        words = put(made.scene / file, kind)
        problem = made.read()
        assert [i.instance_id for i in problem.instances] == [0, 2]
        assert any(words in note for note in problem.notes), problem.notes


def test_results_detections_and_orders_that_are_no_files(tmp_path: Path) -> None:
    made = make(tmp_path / "boxes")
    for name, used in (
        ("r.csv", lambda path: refusal(made, HypothesesSettings(source="results", files=(path,)))),
        ("d.json", lambda path: refusal(made, masks=path)),
        ("o.json", lambda path: _refused_order(Path(path))),
    ):
        for kind in KINDS:
            words = put(tmp_path / name, kind)
            assert words in used(str(tmp_path / name)), (name, kind)


def test_what_is_no_file_is_not_scored_with(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("7,3,5,1,1 0 0 0 1 0 0 0 1,0 0 500,-1\n")
    for n, file in enumerate([*FILES[2:6], FILES[-1]]):
        made = make(tmp_path / str(n))
        words = put(made.scene / file, "pipe")
        with pytest.raises(InputError) as refused:
            evaluate_files([tmp_path / "r.csv"], made.root)
        assert words in str(refused.value)


def _refused_order(path: Path) -> str:
    with pytest.raises(InputError) as refused:
        read_orders(path)
    return str(refused.value)


def test_a_nul_in_a_path_is_one_line() -> None:
    for read in (read_results, read_orders, lambda path: read_json(path, dict[str, object])):
        with pytest.raises(InputError, match="holds a NUL character"):
            read(Path("a\0b"))


def test_textures_and_materials_that_are_no_files_are_a_note(tmp_path: Path) -> None:
    made = make(tmp_path / "boxes")
    ply, obj = tmp_path / "a.ply", tmp_path / "b.obj"
    ply.write_text(box_ply(made.problem).replace("1.0\n", "1.0\ncomment TextureFile skin.png\n", 1))
    obj.write_text("mtllib b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for kind in ("pipe", "device", "loop"):
        for mesh, named in ((ply, "skin.png"), (obj, "b.mtl")):
            words = put(tmp_path / named, kind)
            (note,) = read_mesh(mesh, 1e-3).notes
            assert note.endswith(f"{words}; {mesh.name} is drawn in one colour")


def test_textures_with_impossible_names_are_a_short_note(tmp_path: Path) -> None:
    made = make(tmp_path / "boxes")
    ply = tmp_path / "a.ply"
    for name in ("x" * 300 + ".png", "a\0b.png"):
        ply.write_text(box_ply(made.problem).replace("1.0\n", f"1.0\ncomment TextureFile {name}\n", 1))
        (note,) = read_mesh(ply, 1e-3).notes
        assert note.endswith("of a.ply is missing; the model is drawn in one colour")
        assert len(note) < 200
        assert note.isprintable()


def test_two_folders_of_a_scene_are_refused_and_another_scene_is_read(tmp_path: Path) -> None:
    made = make(tmp_path)
    shutil.copytree(made.scene, made.scene.with_name("8"))
    shutil.copytree(made.scene, made.scene.with_name("7"))
    assert "000007 and 7 are both scene 7; rename or remove one of them" in refusal(made, frames=("7/3",))
    assert "are both scene 7" in refusal(made)
    assert made.open(frames=("8/3",)).problem("8/3").scene_id == 8


def test_two_meshes_of_an_object_are_refused(tmp_path: Path) -> None:
    made = make(tmp_path)
    shutil.copy(made.root / "models/obj_000005.ply", made.root / "models/obj_5.ply")
    assert "obj_000005.ply and obj_5.ply are both object 5; rename or remove one of them" in refusal(made)


def test_names_and_keys_with_more_or_fewer_zeros_are_the_same(tmp_path: Path) -> None:
    plain, other = make(tmp_path / "a"), make(tmp_path / "b")
    turn = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    for made in (plain, other):
        made.edit("../../models/models_info.json", lambda c: c["5"].update(symmetries_discrete=[turn]))
        (made.root / "models/obj_names.json").write_text(json.dumps({"5": "mug"}))
    files = [f"scene_{name}.json" for name in ("camera", "gt", "gt_info")]
    for file in (*files, "../../models/models_info.json", "../../models/obj_names.json"):
        other.edit(file, lambda c: [c.update({key.zfill(6): c.pop(key)}) for key in list(c)])
    (other.root / "models/obj_000005.ply").rename(other.root / "models/obj_5.ply")
    one, same = plain.read(), other.read()
    assert [i.visib_fract for i in same.instances] == [i.visib_fract for i in one.instances]
    assert same.models[5].name == "mug"
    assert len(same.models[5].symmetries) == 2
    assert same.models[5].mesh_hash == one.models[5].mesh_hash
    results = tmp_path / "r.csv"
    results.write_text("7,3,5,1,1 0 0 0 1 0 0 0 1,0 0 500,-1\n7,3,2,1,1 0 0 0 1 0 0 0 1,0 0 500,-1\n")
    scores = [evaluate_files([results], made.root).scores[0].recalls.ar for made in (plain, other)]
    assert scores[0] == scores[1]


def test_names_are_cleaned_of_what_no_file_can_hold(tmp_path: Path) -> None:
    made = make(tmp_path)
    (made.root / "models/obj_names.json").write_text('{"2": "a\\ud800b", "5": "x\\n\\u001b[31m"}')
    models = made.read().models
    assert (models[2].name, models[5].name) == ("a�b", "x �[31m")
    models[2].name.encode()


def test_names_that_cannot_be_used(tmp_path: Path) -> None:
    made = make(tmp_path)
    for names, words in (
        ({"5": "a", "000005": "b"}, "obj_names.json names object 5 twice; delete one of the names"),
        ({"5": "x" * 201}, "the name of object 5 has 201 characters, expected 1 to 200"),
        ({"5": ""}, "the name of object 5 has 0 characters, expected 1 to 200"),
        ({"can": "9" * 5000}, "does not name an object id"),
    ):
        (made.root / "models/obj_names.json").write_text(json.dumps(names))
        assert words in refusal(made)


def test_masks_are_held_once(tmp_path: Path) -> None:
    made = make(tmp_path)
    path = find_image(made.scene / "mask_visib", "000003_000001")
    mask = read_mask(path, (60, 80))
    assert replace(made.read().instances[1], mask=mask).mask is mask
