"""Labels as ground truth in BOP layout: what is written, where, and what stays as it is."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.batch.frames import batch_here, write_session
from tests.labels.labelled import bare_dataset, files_below, frames_in, label, labels_of, problems
from tests.progress import ending_after
from tests.scenes.bop_folder import Made
from tests.scenes.test_trace import K, picture, pose, write_box
from verefine_viz.commands.dataset_check import check_split
from verefine_viz.core.errors import Cancelled, InputError
from verefine_viz.core.geometry import transform
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.evaluation.proposed_symmetries import proposed_symmetries
from verefine_viz.evaluation.results_scores import evaluate_files
from verefine_viz.labels.bop_writing import labels_to_write, write_into_dataset, write_new_dataset
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.labels import Label
from verefine_viz.scenes.results_csv import ResultRow, write_results
from verefine_viz.scenes.segments import silhouette
from verefine_viz.scenes.source import open_scene
from verefine_viz.trace import Trace

OURS = {"scene_gt.json", "scene_gt_info.json"}


def opened(folder: Path) -> Any:
    return open_scene(SceneSettings(source="bop", dataset=str(folder), model_points=500), HypothesesSettings())


def advice(folder: Path) -> dict[str, str]:
    return {one.name: one.advice for one in check_split(folder, "test").findings if one.advice}


def results(path: Path, labels: dict[str, tuple[Label, ...]], off_mm: float = 0.0) -> Path:
    off = transform(np.eye(3), [off_mm * 1e-3, 0, 0])
    rows = [
        ResultRow(*map(int, frame.split("/")), one.obj_id, 0.9, off @ one.pose, 0.1)
        for frame, of in labels.items()
        for one in of
    ]
    write_results(path, rows)
    return path


def test_a_data_set_gets_the_truth_of_its_labels_and_nothing_else_changes(tmp_path: Path) -> None:
    made = problems()
    folder = bare_dataset(tmp_path / "boxes", made)
    before, labels = files_below(folder), labels_of(made)
    written = write_into_dataset(frames_in(folder), labels_to_write(labels))
    assert (written.n_frames, written.n_objects, written.notes) == (2, 4, ())
    after = files_below(folder)
    assert before.items() <= after.items()
    new = {Path(name).name for name in after.keys() - before.keys()}
    masks = {f"{im:06d}_{k:06d}.png" for im in (0, 1) for k in (0, 1)}
    assert new == {*OURS, *masks, "models_info.json"}
    assert advice(folder) == {}
    source = opened(folder)
    assert source.frames == ("3/0", "3/1")
    dataset = BopDataset(folder, "test")
    for problem in made:
        again = source.problem(problem.frame)
        for one, true in zip(again.instances, problem.instances, strict=True):
            np.testing.assert_allclose(one.T_cam_obj_gt, true.T_cam_obj_gt, atol=1e-12)
            outline = silhouette(again.models[one.obj_id], one.T_cam_obj_gt, again.observation.camera)
            mask = dataset.mask(3, problem.im_id, one.instance_id, "mask", outline.shape)
            np.testing.assert_array_equal(mask, outline)
            # The frame's own mask is that of an ideal sensor; depth is noisy at edges alone.
            assert np.count_nonzero(one.mask & ~true.mask) == 0
            assert np.count_nonzero(one.mask) > 0.99 * np.count_nonzero(true.mask)
    carton, can = json.loads((folder / "test/000003/scene_gt_info.json").read_text())["0"]
    assert carton["visib_fract"] < 0.95 < can["visib_fract"]


@pytest.mark.usefixtures("long_run")
def test_batch_and_evaluate_run_on_what_was_written(tmp_path: Path) -> None:
    made = problems(1)
    folder = bare_dataset(tmp_path / "boxes", made)
    labels = labels_of(made)
    write_into_dataset(frames_in(folder), labels_to_write(labels))
    session = write_session(
        tmp_path, Made(folder, folder / "test" / "000003", made[0], "3/0"), physics={"collider": "hull"}
    )
    assert batch_here(session, tmp_path / "out", "--workers", "1").returncode == 0
    files = [results(tmp_path / "true_boxes-test.csv", labels), tmp_path / "out" / "results.csv"]
    true, solved = evaluate_files(files, folder).scores
    assert true.recalls is not None
    assert true.recalls.ar == 1
    assert solved.recalls is not None
    assert solved.counts.answered == 2
    assert solved.recalls.ar > 0.5


def test_symmetries_are_written_where_they_were_confirmed(tmp_path: Path) -> None:
    made = problems(1)
    folder = bare_dataset(tmp_path / "boxes", made)
    source, labels = frames_in(folder), labels_to_write(labels_of(made))
    can = made[0].instances[1].obj_id
    write_into_dataset(source, labels, {can: proposed_symmetries(source.models.get(can))[:1]})
    infos = folder / "models" / "models_info.json"
    first = json.loads(infos.read_text())
    assert {key for entry in first.values() for key in entry if "symm" in key} == {"symmetries_continuous"}
    axis = first[str(can)]["symmetries_continuous"][0]
    assert axis["axis"] == [0, 0, 1]
    assert frames_in(folder).models.get(can).is_symmetric
    # What it states stays, also where it is written again.
    first[str(can)]["diameter"] += 1
    first["77"] = {"diameter": 5.0}
    infos.write_text(json.dumps(first))
    confirmed = {can: proposed_symmetries(source.models.get(can))[1:]}
    for place in ("mask", "mask_visib"):
        shutil.rmtree(folder / "test" / "000003" / place)
    for name in OURS:
        (folder / "test" / "000003" / name).unlink()
    assert len(write_into_dataset(frames_in(folder), labels, confirmed).notes) == 1
    assert json.loads(infos.read_text()) == first
    write_into_dataset(frames_in(folder), labels, confirmed, overwrite=True)
    second = json.loads(infos.read_text())
    upside_down = second[str(can)].pop("symmetries_discrete")
    assert second == first
    assert len(upside_down) == 1
    assert np.reshape(upside_down, (4, 4))[2, 2] == pytest.approx(-1)
    assert json.loads((folder / "models/replaced-1/models_info.json").read_text()) == first


def test_what_is_there_is_not_replaced_without_being_asked_and_kept_where_it_is(tmp_path: Path) -> None:
    made = problems(1)
    folder = bare_dataset(tmp_path / "boxes", made)
    scene = folder / "test" / "000003"
    labels = labels_of(made)
    for place, content in (("scene_gt.json", "{}"), ("mask", "")):
        path = scene / place
        if content:
            path.write_text(content)
        else:
            path.mkdir()
            (path / "theirs.txt").write_text("theirs")
        before = files_below(folder)
        with pytest.raises(InputError, match=rf"{place} is there already"):
            write_into_dataset(frames_in(folder), labels_to_write(labels))
        assert files_below(folder) == before
    for n, shift_m in ((1, 0.0), (2, 0.001)):
        before = files_below(scene)
        write_into_dataset(frames_in(folder), labels_to_write(labels_of(made, shift_m)), overwrite=True)
        after = files_below(scene)
        moved = {name for name in before if name.startswith(("mask", "scene_gt"))}
        assert {name: after[f"replaced-{n}/{name}"] for name in moved} == {name: before[name] for name in moved}
    assert advice(folder) == {}


def test_what_ends_early_or_fails_leaves_all_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = problems()
    folder = bare_dataset(tmp_path / "boxes", made)
    labels, before = labels_to_write(labels_of(made)), files_below(tmp_path)
    with pytest.raises(Cancelled):
        write_into_dataset(frames_in(folder), labels, progress=ending_after(1))
    with pytest.raises(Cancelled):
        write_new_dataset(frames_in(folder), labels, tmp_path / "out", progress=ending_after(1))
    renamed = Path.rename

    def refused(path: Path, target: Path) -> Path:
        if target.name == "scene_gt.json":
            raise OSError(28, "No space left on device", str(target))
        return renamed(path, target)

    monkeypatch.setattr(Path, "rename", refused)
    with pytest.raises(InputError, match=r"cannot write .*No space left on device"):
        write_into_dataset(frames_in(folder), labels)
    assert files_below(tmp_path) == before


def test_no_link_is_written_through(tmp_path: Path) -> None:
    made = problems(1)
    labels = labels_to_write(labels_of(made))
    for name in ("test", "test/000003", "models"):
        folder, theirs = bare_dataset(tmp_path / name / "boxes", made), tmp_path / name / "theirs"
        (folder / name).rename(theirs)
        (folder / name).symlink_to(theirs)
        before = files_below(theirs)
        with pytest.raises(InputError, match=rf"{name}: it is a link to .*theirs, expected a folder"):
            write_into_dataset(frames_in(folder), labels)
        assert files_below(theirs) == before, name
        # The folder of another program's data may be reached by links; what is written from it is not.
        write_new_dataset(frames_in(folder), labels, tmp_path / name / "out")
        assert files_below(theirs) == before, name
        assert not [path for path in (tmp_path / name / "out").rglob("*") if path.is_symlink()]


def test_only_accepted_labels_count_and_what_cannot_be_used_is_named(tmp_path: Path) -> None:
    made = problems()
    folder = bare_dataset(tmp_path / "boxes", made)
    carton, can = labels_of(made)["3/0"]
    labels = {
        "3/0": (carton, label(1, can.obj_id, can.pose, "uncertain"), label(2, 99, can.pose)),
        "3/1": (label(0, can.obj_id, can.pose, "proposed"),),
        "3/8": (can,),
        "9/8": (can,),
    }
    written = write_into_dataset(frames_in(folder), labels_to_write(labels))
    assert (written.n_frames, written.n_objects, len(written.notes)) == (1, 1, 2)
    assert "99" in written.notes[0]
    assert "2 frames of boxes" in written.notes[1]
    truth = json.loads((folder / "test/000003/scene_gt.json").read_text())
    assert {im_id: len(of) for im_id, of in truth.items()} == {"0": 1}
    labels["3/1"] = ()
    write_into_dataset(frames_in(folder), labels_to_write(labels, with_uncertain=True), overwrite=True)
    truth = json.loads((folder / "test/000003/scene_gt.json").read_text())
    assert {im_id: len(of) for im_id, of in truth.items()} == {"0": 2, "1": 0}
    proposed = {"3/0": (label(0, can.obj_id, can.pose, "proposed"),)}
    with pytest.raises(InputError, match="there is no label to write"):
        write_new_dataset(frames_in(folder), labels_to_write(proposed), tmp_path / "out")


def test_a_new_data_set_has_the_images_as_they_are(tmp_path: Path) -> None:
    made = problems()
    folder, labels = bare_dataset(tmp_path / "boxes", made), labels_of(made)
    out = tmp_path / "labels"
    out.mkdir()
    (out / "labels.json").write_text("{}")
    before = files_below(folder)
    written = write_new_dataset(frames_in(folder), labels_to_write(labels), out)
    assert (written.n_frames, written.n_objects) == (2, 4)
    assert files_below(folder) == before
    assert advice(out) == {}
    for name in ("depth/000000.png", "rgb/000001.png"):
        there, here = folder / "test/000003" / name, out / "test/000003" / name
        assert here.stat().st_ino == there.stat().st_ino or here.read_bytes() == there.read_bytes()
    cameras = [json.loads((one / "test/000003/scene_camera.json").read_text()) for one in (folder, out)]
    assert cameras[0] == cameras[1]
    scores = evaluate_files([results(tmp_path / "true_labels-test.csv", labels)], out)
    assert scores.is_official  # By the targets file that was written.
    assert scores.scores[0].counts.targets == 4
    with pytest.raises(InputError, match="models is there already"):
        write_new_dataset(frames_in(folder), labels_to_write(labels), out)
    again = write_new_dataset(frames_in(folder), labels_to_write({"3/0": labels["3/0"]}), out, overwrite=True)
    assert again.n_frames == 1
    assert (out / "replaced-1/test/000003/mask/000001_000000.png").is_file()
    assert advice(out) == {}


def test_frames_of_another_layout_become_a_data_set(tmp_path: Path) -> None:
    depth_m, mask = picture()
    box = write_box(tmp_path / "box.obj")
    rgb = np.full((*depth_m.shape, 3), 40, np.uint8)
    trace = Trace(tmp_path / "traced" / "frame-7", K, depth_m, rgb)
    trace.object("box", box, mask, unit_m=0.001)
    trace.close()
    source = frames_in(tmp_path / "traced")
    labels = {source.frames[0]: (label(0, 1, pose()),)}
    with pytest.raises(InputError, match="no data set in BOP layout"):
        write_into_dataset(source, labels_to_write(labels))
    write_new_dataset(source, labels_to_write(labels), tmp_path / "out")
    assert {k: v for k, v in advice(tmp_path / "out").items() if k != "plausibility"} == {}
    problem = opened(tmp_path / "out").problem(source.frames[0])
    np.testing.assert_allclose(problem.observation.depth_m, depth_m, atol=1e-4)
    np.testing.assert_array_equal(problem.observation.rgb, rgb)
    np.testing.assert_array_equal(problem.observation.camera.K, K)
    outline = silhouette(source.models.get(1), pose(), problem.observation.camera)
    np.testing.assert_array_equal(problem.instances[0].mask, outline)
    np.testing.assert_allclose(problem.models[1].vertices, source.models.get(1).vertices, atol=1e-12)


@pytest.mark.usefixtures("long_run")
def test_scores_against_labels_are_those_against_official_truth(shared_data: Path, tmp_path: Path) -> None:
    """Published results of real estimators; labels are the official poses, exactly and off by 1 mm."""
    official = shared_data / "ycbv"
    source = frames_in(official)
    dataset = BopDataset(official, "test")
    files = sorted((official / "pose_estimates").glob("*.csv"))
    scores: dict[str, list[list[float]]] = {}
    for name, shift_m in (("official", None), ("labels", 0.0), ("off by 1 mm", 0.001)):
        folder = official
        if shift_m is not None:
            off = transform(np.eye(3), [0, 0, shift_m])
            truths = {ids: dataset.ground_truth(*ids) or () for ids in dataset.frames}
            labels = {ids: [label(t.gt_id, t.obj_id, off @ t.T_cam_obj) for t in of] for ids, of in truths.items()}
            folder = tmp_path / name.replace(" ", "-")
            write_new_dataset(source, labels, folder)
        recalls = [one.recalls for one in evaluate_files(files, folder).scores if one.recalls is not None]
        scores[name] = [[one.ar, one.ar_vsd, one.ar_mssd, one.ar_mspd] for one in recalls]
    assert len(scores["official"]) == 4
    assert scores["labels"] == scores["official"]
    assert 0 < np.abs(np.subtract(scores["off by 1 mm"], scores["official"])).max() < 0.015
