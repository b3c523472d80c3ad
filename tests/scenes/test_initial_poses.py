"""Initial poses: disturbed ground truth has the error asked for; rows of results files, and whose a row is."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import structs

from tests.scenes.bop_folder import POSE, Made, make
from tests.scenes.test_trace import pose
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import angle_between, axis_angle, rotation_of_quat_wxyz, rotation_vector, transform
from verefine_viz.core.settings import HypothesesSettings
from verefine_viz.scenes.hypothesis_pool import perturbed
from verefine_viz.scenes.results_csv import HEADER, ResultRow, method_of, read_poses, read_results, write_results
from verefine_viz.scenes.results_files import read_estimates

T_GT = transform(axis_angle([1, 2, 3], 0.7), [0.1, -0.2, 0.9])
ROWS = [ResultRow(2, k, 5 + k, 0.25 * k, pose(10.0 * k, 0.01)) for k in range(3)]
POSES = np.stack([row.T_cam_obj for row in ROWS])
IDS = {name: np.array([getattr(row, name) for row in ROWS]) for name in ("scene_id", "im_id", "obj_id")}
SCORES = np.array([row.score for row in ROWS])
poses = st.builds(
    lambda q, t: transform(rotation_of_quat_wxyz(q), t),
    st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.lists(st.floats(-5, 5), min_size=3, max_size=3),
)
ids = st.integers(0, 10**6)
rows = st.builds(ResultRow, ids, ids, ids, st.floats(-1e6, 1e6), poses, st.just(0.25))


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 179), st.floats(0, 200), st.integers(0, 2**31))
def test_the_error_is_exactly_as_asked(rotation_deg: float, translation_mm: float, seed: int) -> None:
    for h in perturbed(T_GT, 3, rotation_deg, translation_mm, seed):
        turned = angle_between(T_GT[:3, :3], h.T_cam_obj[:3, :3])
        assert np.degrees(turned) == pytest.approx(rotation_deg, abs=1e-6)
        assert np.linalg.norm(h.T_cam_obj[:3, 3] - T_GT[:3, 3]) * 1e3 == pytest.approx(translation_mm, abs=1e-9)


def test_axes_and_directions_are_uniform() -> None:
    poses = [h.T_cam_obj for h in perturbed(T_GT, 3000, 30, 30, 1)]
    axes = np.array([rotation_vector(T[:3, :3] @ T_GT[:3, :3].T) for T in poses]) / np.radians(30)
    directions = np.array([T[:3, 3] - T_GT[:3, 3] for T in poses]) / 0.030
    for vectors in (axes, directions):
        # Mean 0 and variance 1/3 along every axis; 5 standard errors at n = 3000.
        np.testing.assert_allclose(vectors.mean(axis=0), 0, atol=5 * np.sqrt(1 / 3 / 3000))
        np.testing.assert_allclose(vectors.T @ vectors / 3000, np.eye(3) / 3, atol=0.03)
    # The axis tells nothing about the direction.
    np.testing.assert_allclose(axes.T @ directions / 3000, 0, atol=5 / 3 / np.sqrt(3000))


def test_it_depends_on_the_seed_only_and_grows_at_the_end() -> None:
    short, long = perturbed(T_GT, 2, 30, 30, (1, 2, 3)), perturbed(T_GT, 5, 30, 30, (1, 2, 3))
    other = perturbed(T_GT, 2, 30, 30, (1, 2, 4))
    assert [h.T_cam_obj.tobytes() for h in short] == [h.T_cam_obj.tobytes() for h in long[:2]]
    assert short[0].T_cam_obj.tobytes() != other[0].T_cam_obj.tobytes()
    assert [h.source for h in short] == ["perturbed 30° 30 mm #1", "perturbed 30° 30 mm #2"]


def test_frames_are_disturbed_independently_of_each_other(tmp_path) -> None:
    made = make(tmp_path, targets=False)
    made.edit("scene_camera.json", lambda c: c.update({"4": c["3"]}))
    h = HypothesesSettings(max_per_object=2)
    alone = made.open(h, frames=("7/3",)).problem("7/3")
    source = made.open(h)
    assert source.frames == ("7/3", "7/4")
    among = source.problem("7/3")
    for a, b in zip(alone.instances, among.instances, strict=True):
        assert [x.T_cam_obj.tobytes() for x in a.hypotheses] == [x.T_cam_obj.tobytes() for x in b.hypotheses]
    errors = {x.T_cam_obj[:3, :3].tobytes() for i in among.instances for x in i.hypotheses}
    assert len(errors) == 6


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(rows, min_size=1, max_size=5))
def test_written_files_read_back_as_they_were(tmp_path: Path, rows: list[ResultRow]) -> None:
    path = tmp_path / "ours_x-test.csv"
    write_results(path, rows)
    back = read_results(path)
    assert len(back) == len(rows)
    for got, want in zip(back, rows, strict=True):
        assert (got.scene_id, got.im_id, got.obj_id) == (want.scene_id, want.im_id, want.obj_id)
        assert (got.score, got.time_s) == (want.score, want.time_s)
        np.testing.assert_allclose(got.T_cam_obj, want.T_cam_obj, atol=1e-14)


def same(path: Path, with_scores: bool = True) -> bool:
    rows = read_estimates(path).rows
    ids = [(row.scene_id, row.im_id, row.obj_id) for row in rows]
    scores = [row.score for row in rows] == (SCORES.tolist() if with_scores else [1.0] * len(ROWS))
    is_close = all(np.allclose(a.T_cam_obj, b.T_cam_obj, atol=1e-6) for a, b in zip(rows, ROWS, strict=True))
    return scores and is_close and ids == [(row.scene_id, row.im_id, row.obj_id) for row in ROWS]


def test_csv_arrays_and_yaml_hold_the_same_rows(tmp_path: Path) -> None:
    in_mm = POSES.copy()
    in_mm[:, :3, 3] *= 1000
    others = {"scene_id": IDS["scene_id"], "image_id": IDS["im_id"], "object_id": IDS["obj_id"]}
    write_results(tmp_path / "a.csv", ROWS)
    np.savez(tmp_path / "b.npz", **IDS, score=SCORES, R=POSES[:, :3, :3], t=in_mm[:, :3, 3])
    np.savez(tmp_path / "c.npz", **IDS, scores=SCORES, poses=POSES[:, :3])
    assert all(same(tmp_path / name) for name in ("a.csv", "b.npz", "c.npz"))
    np.savez(tmp_path / "d.npz", **others, poses=in_mm)
    lines = ["2:"]
    for row in ROWS:  # As FoundationPose writes them.
        numbers = "\n".join(f"      - {line.tolist()}" for line in row.T_cam_obj)
        lines += [f"  '{row.im_id:06d}':", f"    {row.obj_id}:", numbers]
    (tmp_path / "e.yml").write_text("\n".join(lines))
    assert all(same(tmp_path / name, with_scores=False) for name in ("d.npz", "e.yml"))


def test_estimates_that_are_none_are_refused(tmp_path: Path) -> None:
    for name, content, message in (
        ("a.pkl", pickle.dumps({"pose": 1}), "pickled"),
        ("a.yml", b"2: {3: {1: [1, 2]}}", "2, 3, 1: Expected 16 numbers"),
        ("a.yml", b"2: &a {1: {1: [1]}}\n3: *a\n", "aliases"),
        ("a.yml", b"[", "line 2"),
        ("a.npz", b"PK", "a.npz"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=message):
            read_estimates(tmp_path / name)
    for arrays, message in (
        ({**IDS, "poses": POSES[:2]}, "2, 3 entries"),
        ({**IDS, "poses": POSES * np.nan}, "finite"),
        ({**IDS}, "neither 'poses' nor 'R' and 't'"),
        ({"poses": POSES}, "scene_id"),
    ):
        np.savez(tmp_path / "a.npz", **arrays)
        with pytest.raises(InputError, match=message):
            read_estimates(tmp_path / "a.npz")


@pytest.mark.parametrize("header", ["", f"{HEADER}\n"])
def test_a_byte_order_mark_is_read_over(tmp_path: Path, header: str) -> None:
    path = tmp_path / "excel_x-test.csv"
    path.write_text(f"{header}1,2,3,0.5,1 0 0 0 1 0 0 0 1,0 0 500,-1\n", encoding="utf-8-sig")
    assert [row.scene_id for row in read_results(path)] == [1]


def test_writing_leaves_no_half_file(tmp_path: Path) -> None:
    path = tmp_path / "ours_x-test.csv"
    row = ResultRow(1, 2, 3, 0.5, np.eye(4))
    write_results(path, [row])
    before = path.read_bytes()

    def failing():
        yield row
        raise RuntimeError("killed here")

    with pytest.raises(RuntimeError):
        write_results(path, failing())
    assert path.read_bytes() == before


def test_method_of_a_file_name() -> None:
    for name, method in (
        ("cosypose_ycbv-test.csv", "cosypose"),
        ("posecnn-icp-rss2018_ycbv-test.csv", "posecnn-icp-rss2018"),
        ("my_own_lmo-test_primesense.csv", "my_own"),
        ("gdr_tless-test_primesense_1b2c.csv", "gdr"),
        ("poses.csv", "poses"),
        ("my_poses.csv", "my_poses"),
    ):
        assert method_of(f"/some/where/{name}") == method


def test_a_bad_line_of_a_results_file_is_left_out_and_the_first_is_named(tmp_path: Path) -> None:
    path, good = tmp_path / "est_x-test.csv", f"7,3,5,1.0,{POSE},-1"
    for bad, words in (
        (f"7,3,5,nan,{POSE},-1", "line 3: score"),
        (good.replace("1 0 0 0 1 0 0 0 1", "2 0 0 0 1 0 0 0 1"), "line 3: the pose is not rigid"),
        (good.replace("1 0 0 0 1", "1 0 0 1"), "line 3: R holds 8 numbers"),
        (good[:-3], "line 3: found 6 "),
        ("", "line 3: found a blank line"),
        (good.replace("3", "3.0", 1), "line 3: im_id"),
    ):
        path.write_text("\n".join([HEADER, good, bad, bad, good]))
        read = read_poses(path)
        assert len(read.rows) == 2
        (note,) = read.notes
        assert note.startswith("2 rows ")
        assert words in note
        with pytest.raises(InputError, match=words):  # It would be lost when the file is written again.
            read_results(path)
        path.write_text("\n".join([HEADER, HEADER, bad]))
        with pytest.raises(InputError, match="line 2: "):
            read_poses(path)
    path.write_text("\n".join([HEADER.replace(",", ";"), good]))
    with pytest.raises(InputError, match="line 1: "):
        read_results(path)


def results(folder: Path, *lines: str, name: str = "est_x-test.csv") -> HypothesesSettings:
    """Initial poses out of a results file of these lines."""
    (folder / name).write_text("\n".join(lines))
    return HypothesesSettings(source="results", files=(str(folder / name),))


def line(obj_id: int, score: float, T: np.ndarray) -> str:
    R, t = " ".join(map(repr, T[:3, :3].ravel().tolist())), " ".join(map(repr, (T[:3, 3] * 1e3).tolist()))
    return f"7,3,{obj_id},{score},{R},{t},-1"


def test_each_row_goes_to_the_instance_it_overlaps(made: Made, tmp_path: Path) -> None:
    left, middle, right = made.truth
    shift = transform(np.eye(3), [0.01, 0, 0])
    lines = [line(2, 0.9, right), line(2, 0.8, left), line(2, 0.7, shift @ left), line(5, 0.6, middle)]
    problem = made.read(results(tmp_path, HEADER, *lines))
    assert [[h.confidence for h in i.hypotheses] for i in problem.instances] == [[0.8, 0.7], [0.6], [0.9]]
    # With one of the two instances selected, the other one's rows still belong to the other one.
    np.testing.assert_allclose(problem.instances[2].hypotheses[0].T_cam_obj, right, atol=1e-12)
    assert problem.notes == ()


def test_a_row_beside_all_masks_goes_to_the_nearest(made: Made, tmp_path: Path) -> None:
    aside = transform(np.eye(3), [0, -0.2, 0]) @ made.truth[2]
    problem = made.read(results(tmp_path, line(2, 1.0, aside)))
    assert [len(i.hypotheses) for i in problem.instances] == [0, 0, 1]


def test_files_take_turns_and_none_is_starved(made: Made, tmp_path: Path) -> None:
    T = made.truth[1]
    apart = [transform(np.eye(3), [0.001 * k, 0, 0]) @ T for k in range(4)]
    lines = [line(5, score, X) for score, X in zip((0.5, 0.9, 0.7, 0.6), apart, strict=True)]
    many = results(tmp_path, *lines, name="many_x-test.csv")
    few = results(tmp_path, line(5, 0.01, apart[0]), line(5, 0.02, apart[1]), name="few_x-test.csv")
    pools = {}
    for n in (3, 5, 9):
        h = HypothesesSettings(source="results", files=many.files + few.files, max_per_object=n)
        pools[n] = [(p.source, p.confidence) for p in made.read(h).instances[1].hypotheses]
    assert pools[9] == [("many", 0.9), ("few", 0.02), ("many", 0.7), ("few", 0.01), ("many", 0.6), ("many", 0.5)]
    assert pools[5] == pools[9][:5]
    assert pools[3] == pools[9][:3]


def test_a_pose_that_is_there_twice_is_tried_once(made: Made, tmp_path: Path) -> None:
    other, T, _ = made.truth
    moved = transform(np.eye(3), [0.001, 0, 0]) @ T
    rows = [line(5, 0.9, T), line(5, 0.8, moved), line(2, 0.7, other)]
    source = made.open(results(tmp_path, *rows, *rows))
    assert ": 3 rows " in source.notes[0]
    poses = [[x.confidence for x in i.hypotheses] for i in source.problem(made.frame).instances]
    assert poses == [[0.7], [0.9, 0.8], []]


def test_translations_that_look_like_metres_are_noted(made: Made, tmp_path: Path) -> None:
    in_metres = [transform(T[:3, :3], 1e-3 * T[:3, 3]) for T in made.truth]
    rows = [line(k, 0.9, T) for k, T in zip((2, 5, 2), in_metres, strict=True)]
    source = made.open(results(tmp_path, *rows))
    assert "metres" in source.notes[0]
    assert source.check_initial_poses() == ()
    # One pose at the camera is no sign of it.
    assert made.open(results(tmp_path, *rows, line(2, 0.8, made.truth[0]))).notes == ()


def of_ids(folder: Path, ids: str, name: str = "est_x-test.csv") -> HypothesesSettings:
    return results(folder, HEADER, f"{ids},1.0,{POSE},-1\n", name=name)


def test_rows_that_are_all_of_something_else_are_refused_before_a_frame_is_read(made: Made, tmp_path: Path) -> None:
    for ids, objects, numbers in (("7,3,77", (), "2, 5, .* 77"), ("8,3,2", (), "7/3.* 8/3"), ("7,3,2", (5,), "5, .*2")):
        with pytest.raises(InputError, match=rf"^est_x-test\.csv .*{numbers}"):
            made.open(of_ids(tmp_path, ids), objects=objects).check_initial_poses()
    # Beside a file that has rows it is named; and an estimator may look for what no file has.
    foreign, ours = of_ids(tmp_path, "8,3,2", "other_x-test.csv"), of_ids(tmp_path, "7,3,5")
    both = structs.replace(ours, files=(*foreign.files, *ours.files))
    (note,) = made.open(both).check_initial_poses()
    assert note.startswith("other_x-test.csv ")
    assert made.open(ours).check_initial_poses() == ()
    assert made.open(structs.replace(foreign, estimate=(("7/3", 1, "ppf"),))).check_initial_poses() == ()


def notes_of(made: Made, *lines: str) -> list[str]:
    return [note for note in made.read(results(made.root, *lines)).notes if "#" in note]


def test_an_instance_whose_rows_another_one_took_says_which(made: Made) -> None:
    left, middle, _ = made.truth
    rows = [line(2, 0.9, transform(np.eye(3), [x, 0, 0]) @ left) for x in (0.0, 0.01)]
    for n in (1, 2):
        (note,) = notes_of(made, line(5, 0.9, middle), *rows[:n])
        assert "#0" in note
        assert ("2 rows" in note) == (n == 2)


def test_estimates_far_from_their_depth_are_named(made: Made) -> None:
    left, middle, right = made.truth
    depth_m = float(np.median(made.problem.instances[1].points_cam[:, 2]))
    near = [line(2, 0.9, left), line(2, 0.8, right)]
    assert notes_of(made, *near, line(5, 0.9, middle)) == []
    far, behind = np.array(middle), np.array(middle)
    far[:3, 3] *= 6
    behind[2, 3] = -0.2
    (note,) = notes_of(made, *near, line(5, 0.9, middle), line(5, 0.8, far))
    assert "1 of its 2 " in note
    assert f"{depth_m:.3g} m" in note
    (note,) = notes_of(made, *near, line(5, 0.9, behind), line(5, 0.8, far))
    assert "2 of its 2 " in note
    assert "behind the camera" in note


def test_rows_out_of_reach_give_no_pose_and_the_others_do(made: Made, tmp_path: Path) -> None:
    near, far = f"7,3,5,1,{POSE},-1", "7,3,5,2,1 0 0 0 1 0 0 0 1,0 0 1e30,-1"
    source = made.open(results(tmp_path, near, far))
    assert "100 m" in source.notes[0]
    (instance,) = [i for i in source.problem("7/3").instances if i.obj_id == 5]
    assert [h.confidence for h in instance.hypotheses] == [1.0]
    with pytest.raises(InputError, match="100 m"):
        made.open(results(tmp_path, far))
