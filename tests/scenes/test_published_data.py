"""Published files as they are: one rule for rotations at every door, and the smallest bad part is left out."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import trimesh
from PIL import Image

import verefine_viz as vv
from tests.batch.frames import make_frames
from tests.fakes import BOX_M, box_problem
from tests.scenes.bop_folder import OBJ_IDS, Made, cut, make
from tests.scenes.test_foundation_pose import write_sequence
from tests.scenes.test_graspa_layout import OBJECT
from tests.scenes.test_layouts import (
    ERASER,
    write_deepim,
    write_extended_apc,
    write_linemod,
    write_megapose,
    write_sam6d,
    write_ycb_video,
    yml_of,
)
from tests.scenes.test_trace import K, picture, pose, write_box, write_trace
from verefine_viz import trace
from verefine_viz.commands.dataset_check import check_split
from verefine_viz.commands.datasets import Datasets
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import RIGID_TOLERANCE, rotation_of_quat_wxyz, transform
from verefine_viz.evaluation.ground_truth import BopGroundTruth
from verefine_viz.evaluation.results_scores import evaluate_files
from verefine_viz.library.frame_checks import checked_depth
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.graspa_layout import read_layout
from verefine_viz.scenes.hypothesis_pool import file_notes, open_results
from verefine_viz.scenes.layouts import foundation_pose, linemod_preprocessed, recording_in, sam6d, ycb_video
from verefine_viz.scenes.results_csv import ResultRow, write_results
from verefine_viz.scenes.trace_files import read_trace

DEVIATIONS = (0.0005, 0.004, 0.0095, 0.03, 0.2)
N_TAKEN = 4
EXACT = rotation_of_quat_wxyz([0.9, 0.2, -0.3, 0.1])
GIVEN = [EXACT @ np.diag([1, 1, np.sqrt(1 + off)]) for off in DEVIATIONS] + [EXACT @ np.diag([1, 1, -1])]
"""LINEMOD's rotations are of this kind, up to 0.014; the last one is a mirror image."""
T_M = np.array([0.01, 0.0, 0.55])
POSES = np.stack([transform(R, T_M) for R in GIVEN])
Read = tuple[list[Float | None], list[str]]
"""What became of each pose, and all notes."""


def of_rows(path: Path) -> Read:
    """Six objects, each with one pose."""
    file = open_results(path)
    rows = [file.rows.get((7, 3, k)) for k in range(6)]
    return [None if of is None else of[0].T_cam_obj for of in rows], [*file_notes([file])]


def csv(folder: Path) -> Read:
    path = folder / "gdr_lmo-test.csv"
    write_results(path, [ResultRow(7, 3, k, 0.5, T) for k, T in enumerate(POSES)])
    return of_rows(path)


def npz(folder: Path) -> Read:
    np.savez(folder / "a.npz", scene_id=[7] * 6, im_id=[3] * 6, obj_id=np.arange(6), poses=POSES)
    return of_rows(folder / "a.npz")


def yml(folder: Path) -> Read:
    entries = "".join(f"    {k}: {T.tolist()}\n" for k, T in enumerate(POSES))
    (folder / "res.yml").write_text(f"7:\n  3:\n{entries}")
    return of_rows(folder / "res.yml")


def spoiled(folder: Path) -> Made:
    """A data set of two frames, whose six instances have these rotations as ground truth."""
    made = make_frames(folder, 2)

    def change(content: dict[str, list[dict[str, object]]]) -> None:
        entries = [entry for image in sorted(content, key=int) for entry in content[image]]
        for entry, R in zip(entries, GIVEN, strict=True):
            entry["cam_R_m2c"] = R.ravel().tolist()

    made.edit("scene_gt.json", change)
    return made


def bop(folder: Path) -> Read:
    source = spoiled(folder).open()
    problems = [source.problem(frame) for frame in source.frames]
    of_frames = [note for problem in problems for note in problem.notes if "has no ground truth: " in note]
    assert len(of_frames) == 2
    return [i.T_cam_obj_gt for problem in problems for i in problem.instances], [*source.notes]


def traced(folder: Path) -> Read:
    write_trace(folder / "drop", write_box(folder / "box.obj"), 0)
    calls = folder / "drop" / trace.CALLS
    lines = [json.loads(line) for line in calls.read_text().splitlines()]
    ends = [line for line in lines if line.get("T") is None]
    kept = [line for line in ends if line.get("closed") is None]
    (began,) = (line for line in lines if line.get("hypothesis") == 0)
    kept += [{**began, "hypothesis": k, "T": T.ravel().tolist()} for k, T in enumerate(POSES)]
    calls.write_text("".join(f"{json.dumps(line)}\n" for line in (*kept, *ends[len(ends) - 1 :])))
    frame = read_trace(folder / "drop")
    return [*(h.T_cam_obj for h in frame.objects[0].hypotheses), None, None], [*frame.notes]


def of_foundation_pose(folder: Path) -> Read:
    write_sequence(folder / "mustard", 6)
    for path, T in zip(sorted((folder / "mustard" / "ob_in_cam").iterdir()), POSES, strict=True):
        np.savetxt(path, T)
    reader = foundation_pose.Reader(folder / "mustard")
    return [reader.answers(name)["mustard"][0] for name in reader.names], [*reader.notes]


def of_ycb_video(folder: Path) -> Read:
    write_ycb_video(folder)
    path = folder / "data" / "0048" / "000001-meta.mat"
    meta = {key: value for key, value in scipy.io.loadmat(path).items() if not key.startswith("__")}
    meta |= {"cls_indexes": np.arange(1, 7)[:, None], "poses": POSES[:, :3].transpose(1, 2, 0)}
    scipy.io.savemat(path, meta)
    frame = ycb_video.Reader(folder).frame("0048/000001")
    return [one.T_cam_obj_gt for one in frame.objects], [*frame.notes]


def of_linemod(folder: Path) -> Read:
    write_linemod(folder)
    scene = folder / "data" / "06"
    camera = (scene / "info.yml").read_text().partition("\n")[2]
    (scene / "info.yml").write_text("".join(f"{k}:\n{camera}" for k in range(6)))
    (scene / "gt.yml").write_text("".join(yml_of(T).replace("0:", f"{k}:", 1) for k, T in enumerate(POSES)))
    for kind in ("rgb", "depth", "mask"):
        for k in range(1, 6):
            shutil.copy(scene / kind / "0000.png", scene / kind / f"000{k}.png")
    reader = linemod_preprocessed.Reader(folder)
    frames = [reader.frame(name) for name in reader.names]
    return [frame.objects[0].T_cam_obj_gt for frame in frames], [*dict.fromkeys(n for f in frames for n in f.notes)]


def of_sam6d(folder: Path) -> Read:
    write_sam6d(folder / "example")
    path = folder / "example" / "outputs" / "sam6d_results" / "detection_pem.json"
    one = json.loads(path.read_text())[0]
    entries = [
        {**one, "score": 0.9 - 0.1 * k, "R": T[:3, :3].tolist(), "t": (1e3 * T_M).tolist()} for k, T in enumerate(POSES)
    ]
    path.write_text(json.dumps(entries))
    frame = sam6d.Reader(folder / "example").frame("0")
    return [*(h.T_cam_obj for h in frame.objects[0].hypotheses), None, None], [*frame.notes]


def graspa(folder: Path) -> Read:
    objects = (OBJECT.format(name=k, a=R[0], b=R[1], c=R[2], t=1e3 * T_M) for k, R in enumerate(GIVEN))
    (folder / "layout.xml").write_text(f"<Scene>{''.join(objects)}</Scene>")
    there, notes = read_layout(folder / "layout.xml")
    assert [one.name for one in there] == ["0", "1", "2", "3"]
    return [*(one.T_board_scan for one in there), None, None], [*notes]


def library(folder: Path) -> Read:
    problem = box_problem()
    seen, truth = problem.observation, problem.instances[0].T_cam_obj_gt
    trimesh.creation.box(BOX_M).export(folder / "box.stl")
    frame = vv.Frame(seen.camera.K, seen.depth_m)
    poses = np.array([[*np.hstack([R, truth[:3, 3:]]), [0, 0, 0, 1]] for R in GIVEN])
    frame.add("box", folder / "box.stl", problem.instances[0].mask, poses, scores=np.arange(6.0))
    (instance,) = frame.problem(physics={"enabled": False}).instances
    assert instance.recorded_scores in ((), (0.0, 1.0, 2.0, 3.0))
    scores = vv.score(frame, "box", poses[:N_TAKEN]).score
    assert np.ptp(scores) < 1e-12  # They are one pose.
    with pytest.raises(vv.VerefineError, match=r"pose 4 is not rigid: .* RᵀR is 0\.2 "):
        vv.score(frame, "box", poses)
    hypotheses = [h.T_cam_obj - transform(np.zeros((3, 3)), truth[:3, 3] - T_M) for h in instance.hypotheses]
    return [*hypotheses, None, None], [*frame.problem(physics={"enabled": False}).notes]


WAYS_IN: tuple[Callable[[Path], Read], ...] = (
    csv, npz, yml, bop, traced, of_foundation_pose, of_ycb_video, of_linemod, of_sam6d, graspa, library,
)  # fmt: skip


def test_every_way_in_takes_the_nearest_rotation_and_leaves_out_what_is_none(tmp_path: Path) -> None:
    for way in WAYS_IN:
        (folder := tmp_path / way.__name__).mkdir()
        poses, notes = way(folder)
        name = (way.__name__, notes)
        assert [T is None for T in poses] == [False] * N_TAKEN + [True] * 2, name
        for T in poses[:N_TAKEN]:
            np.testing.assert_allclose(T[:3, :3], EXACT, atol=1e-7, err_msg=way.__name__)
        (rounded,) = (note for note in notes if "rounded rotations" in note)
        assert re.search(r"\(3 of [45], RᵀR up to 0\.03 ", rounded), name
        left_out = [note for note in notes if " is not rigid: " in note]
        assert "RᵀR is 0.2 " in left_out[0], name
        # Once for all with their number, or once for each where all are of one frame.
        assert len(left_out) == 2 or (len(left_out) == 1 and re.match(r"2 \w+ of ", left_out[0])), name


def test_exact_rotations_are_not_accused(tmp_path: Path) -> None:
    made = make_frames(tmp_path / "made", 2)
    assert made.open().notes == ()
    write_results(tmp_path / "a.csv", [ResultRow(7, 3, 1, 0.5, pose(30.0))])
    assert open_results(tmp_path / "a.csv").notes == ()


def test_a_trace_takes_what_its_reader_takes(tmp_path: Path) -> None:
    assert trace.RIGID_TOLERANCE == RIGID_TOLERANCE
    depth, mask = picture()
    with trace.Trace(tmp_path / "drop", K=K, depth_m=depth) as written:
        box = written.object("box", write_box(tmp_path / "box.obj"), mask, 0.001)
        for k in (5, 4, 3, 2, 1, 0):
            box.hypothesis(k, POSES[k])
    assert written.n_problems == 2
    frame = read_trace(tmp_path / "drop")
    assert len(frame.objects[0].hypotheses) == N_TAKEN
    assert any("2 not recorded" in note for note in frame.notes), frame.notes


def test_a_data_set_with_rounded_rotations_needs_no_look(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for offs, code, words in ((DEVIATIONS[:N_TAKEN], 0, "3 of 6, RᵀR up to 0.03 "), (DEVIATIONS, 1, "1 entry of ")):
        made = make_frames(tmp_path / str(code), 2)

        def stretch(content: dict[str, list[dict[str, Any]]], offs: tuple[float, ...] = offs) -> None:
            for entry, off in zip((e for entries in content.values() for e in entries), offs, strict=False):
                R = np.reshape(entry["cam_R_m2c"], (3, 3)) @ np.diag([1, 1, np.sqrt(1 + off)])
                entry["cam_R_m2c"] = R.ravel().tolist()

        made.edit("scene_gt.json", stretch)
        assert Datasets("check", str(made.root)).run([]) == code, capsys.readouterr().out
        (found,) = (f for f in check_split(made.root, "test").findings if f.name == "ground truth")
        assert words in (found.advice or found.result), found
        assert bool(found.advice) == bool(code)


def test_scores_keep_the_digits_of_the_file_and_leave_out_what_is_no_rotation(tmp_path: Path) -> None:
    """As the official ones: rounded ground truth is used as it is written; an estimate's is, whatever it is."""
    made, path = spoiled(tmp_path / "lmo"), tmp_path / "gdr_lmo-test.csv"
    truth = BopGroundTruth(BopDataset(made.root, "test"))
    instances = [gt for k in (0, 1) for gt in truth.image(7, k, with_depth=False).instances]
    assert [gt.R.tobytes() for gt in instances] == [R.tobytes() for R in GIVEN[:N_TAKEN]]
    rows = [ResultRow(7, 0, obj_id, 0.5, made.truth[k]) for k, obj_id in enumerate(OBJ_IDS)]
    write_results(path, [replace(row, T_cam_obj=T) for row, T in zip(rows, POSES[[0, 3, 5]], strict=True)])
    evaluation = evaluate_files([path], made.root)
    left_out, rounded, *_ = (note for note in evaluation.notes if "the ground truth of lmo" in note)
    assert left_out.startswith("2 instances ")
    assert "(3 of 4, RᵀR up to 0.03" in rounded
    assert (evaluation.coverage[0].rounded, evaluation.coverage[0].not_rigid) == (1, 1)
    assert evaluation.scores[0].counts.rows == 3


# Depth that is no number was not measured, at every door.


def test_infinite_depth_was_not_measured(tmp_path: Path) -> None:
    made = make(tmp_path / "made")
    depth_m = np.array(made.problem.observation.depth_m)
    depth_m[0, :3] = [np.inf, -np.inf, np.nan]
    expected = np.where(np.isfinite(depth_m), depth_m, 0)
    (made.scene / "depth" / "000003.png").unlink()
    Image.fromarray((depth_m * 1e4).astype(np.float32)).save(made.scene / "depth" / "000003.tif")
    K = made.problem.observation.camera.K
    with trace.Trace(tmp_path / "drop", K=K, depth_m=depth_m):
        pass
    np.save(tmp_path / "drop" / "depth.npy", depth_m)  # As another program may write it.
    sequence = write_sequence(tmp_path / "mustard", 1)
    (png,) = (sequence / "depth").iterdir()
    Image.fromarray((depth_m * 1e3).astype(np.float32)).save(png.with_suffix(".tif"))
    png.unlink()
    (sequence / "masks" / "1581120424100262100.png").unlink()
    (rgb,) = (sequence / "rgb").iterdir()
    rgb.unlink()
    reader = foundation_pose.Reader(sequence)
    truth = BopGroundTruth(BopDataset(made.root, "test")).image(7, 3, with_depth=True)
    for door, seen in (
        ("bop", made.read().observation.depth_m),
        ("scores", truth.depth_mm / 1e3),
        ("trace", read_trace(tmp_path / "drop").depth_m),
        ("foundation_pose", reader.frame(reader.names[0]).depth_m),
        ("library", checked_depth(depth_m)),
    ):
        np.testing.assert_allclose(seen, expected, atol=1e-6, err_msg=door)


def test_one_bad_part_of_a_foreign_frame_leaves_the_others(tmp_path: Path) -> None:
    write_sequence(tmp_path / "mustard", 1)
    cut(tmp_path / "mustard" / "masks" / "1581120424100262100.png")
    write_trace(tmp_path / "drop", write_box(tmp_path / "box.obj"))
    (mask,) = (tmp_path / "drop").glob("*mask*")
    cut(mask)
    write_sam6d(tmp_path / "sam6d")
    found = tmp_path / "sam6d" / "outputs" / "sam6d_results" / "detection_pem.json"
    entries = json.loads(found.read_text())
    entries[1]["segmentation"]["counts"] = [9]
    found.write_text(json.dumps([*entries, {**entries[0], "R": [1]}, {"score": 0.1}]))
    write_megapose(tmp_path / "megapose")
    answered = tmp_path / "megapose" / "outputs" / "object_data.json"
    answered.write_text(json.dumps([*json.loads(answered.read_text()), {"label": "cup", "TWO": [[0, 1], [0]]}]))
    write_deepim(tmp_path / "deepim")
    refined = tmp_path / "deepim" / "demo" / "deepim_results_RGBD" / "000000-color.png.mat"
    poses = scipy.io.loadmat(refined)["poses_est"]
    poses[0, 0, 2:6] = np.nan
    scipy.io.savemat(refined, {"poses_est": poses})
    write_linemod(tmp_path / "linemod")
    for kind in ("rgb", "depth", "mask"):
        of_kind = tmp_path / "linemod" / "data" / "06" / kind
        shutil.copy(of_kind / "0000.png", of_kind / "0001.png")
    for name in ("gt.yml", "info.yml"):
        file = tmp_path / "linemod" / "data" / "06" / name
        file.write_text(file.read_text() + "1: none\n")
    write_extended_apc(tmp_path / "xapc")
    info = tmp_path / "xapc" / "scene-0004" / "gt_info.yml"
    info.write_text(re.sub(r"(object_1:\n.*\n    pose: )\[[^,]*,", r"\1[", info.read_text()))
    for folder, words in (
        ("mustard", "the mask is left out"),
        ("drop", "box: its mask is left out"),
        ("sam6d", "2 detections of detection_pem.json"),
        ("sam6d", "1 mask of the detections"),
        ("megapose", "1 entry of outputs/object_data.json"),
        ("deepim/demo", "iteration 1 of DeepIM"),
        ("linemod", ""),
        ("xapc", f"{ERASER} has no ground truth"),
    ):
        reader = recording_in(tmp_path / folder)
        frame = reader.frame(reader.names[0])
        notes = (*reader.notes, *frame.notes)
        assert sum(words in note for note in notes if words) == bool(words), (folder, notes)
        assert len(frame.objects) == 1, folder
        has_pose = bool(frame.objects[0].hypotheses) or frame.objects[0].T_cam_obj_gt is not None
        assert has_pose == (folder != "xapc"), folder
