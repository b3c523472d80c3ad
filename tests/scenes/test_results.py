"""Results files: the official verdicts, round trips, and whose a row is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import structs

from tests.scenes.bop_folder import Made, make
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import rotation_of_quat_wxyz, transform
from verefine_viz.core.settings import HypothesesSettings
from verefine_viz.scenes.results_csv import HEADER, ResultRow, method_of, read_results, write_results

poses = st.builds(
    lambda q, t: transform(rotation_of_quat_wxyz(q), t),
    st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.lists(st.floats(-5, 5), min_size=3, max_size=3),
)
ids = st.integers(0, 10**6)
rows = st.builds(ResultRow, ids, ids, ids, st.floats(-1e6, 1e6), poses, st.just(0.25))


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
    h = results(tmp_path, *rows, *rows)
    assert "3 rows repeat a pose of the same object" in made.open(h).notes[0]
    assert [[x.confidence for x in i.hypotheses] for i in made.read(h).instances] == [[0.7], [0.9, 0.8], []]


def test_translations_that_look_like_metres_are_noted(made: Made, tmp_path: Path) -> None:
    in_metres = [transform(T[:3, :3], 1e-3 * T[:3, 3]) for T in made.truth]
    rows = [line(k, 0.9, T) for k, T in zip((2, 5, 2), in_metres, strict=True)]
    source = made.open(results(tmp_path, *rows))
    assert "every pose lies within 20 mm of the camera, so t looks like metres" in source.notes[0]
    assert source.check_initial_poses() == ()
    # One pose at the camera is no sign of it.
    assert made.open(results(tmp_path, *rows, line(2, 0.8, made.truth[0]))).notes == ()


def results_file(folder: Path, ids: str, name: str = "est_x-test.csv") -> HypothesesSettings:
    return results(folder, HEADER, f"{ids},1.0,1 0 0 0 1 0 0 0 1,0 0 500,-1\n", name=name)


def test_rows_that_are_all_of_something_else_are_refused_before_a_frame_is_read(tmp_path: Path) -> None:
    made = make(tmp_path / "boxes")
    for ids, said in (
        ("7,3,77", "an object of the chosen frames: the frames need 2, 5, the rows are of 77; check the object ids"),
        ("8,3,2", "the chosen frames (7/3), only for 8/3; choose other frames or files"),
    ):
        with pytest.raises(InputError) as refused:
            made.open(results_file(tmp_path, ids)).check_initial_poses()
        assert str(refused.value).startswith(f"est_x-test.csv has no row for {said}")
    with pytest.raises(InputError, match=r"the frames need 5, the rows are of 2;"):
        made.open(results_file(tmp_path, "7,3,2"), objects=(5,)).check_initial_poses()


def test_a_file_that_covers_nothing_beside_one_that_does_is_named(made: Made, tmp_path: Path) -> None:
    foreign, ours = results_file(tmp_path, "8,3,2", "other_x-test.csv"), results_file(tmp_path, "7,3,5")
    both = structs.replace(ours, files=(*foreign.files, *ours.files))
    (note,) = made.open(both).check_initial_poses()
    assert note.startswith("other_x-test.csv has no row for an object of the chosen frames")
    assert made.open(ours).check_initial_poses() == ()


def test_an_estimator_may_look_for_what_the_file_does_not_have(tmp_path: Path) -> None:
    rows = structs.replace(results_file(tmp_path, "8,3,2"), estimate=(("7/3", 1, "ppf"),))
    assert make(tmp_path).open(rows).check_initial_poses() == ()


def notes_of(made: Made, *lines: str) -> list[str]:
    return [note for note in made.read(results(made.root, *lines)).notes if "#" in note]


def test_an_instance_whose_rows_another_one_took_says_which(made: Made) -> None:
    left, middle, _ = made.truth
    rows = [line(2, 0.9, transform(np.eye(3), [x, 0, 0]) @ left) for x in (0.0, 0.01)]
    for n, what in ((1, "the only row"), (2, "all 2 rows")):
        (note,) = notes_of(made, line(5, 0.9, middle), *rows[:n])
        assert f"{what} for object 2 of this frame in est went to #0, whose mask fits better" in note


def test_estimates_far_from_their_depth_are_named(made: Made) -> None:
    left, middle, right = made.truth
    depth_m = float(np.median(made.problem.instances[1].points_cam[:, 2]))
    near = [line(2, 0.9, left), line(2, 0.8, right)]
    assert notes_of(made, *near, line(5, 0.9, middle)) == []
    far, behind = np.array(middle), np.array(middle)
    far[:3, 3] *= 6
    behind[2, 3] = -0.2
    (note,) = notes_of(made, *near, line(5, 0.9, middle), line(5, 0.8, far))
    assert f"1 of its 2 poses lies far from the depth inside its mask ({depth_m:.3g} m)" in note
    (note,) = notes_of(made, *near, line(5, 0.9, behind), line(5, 0.8, far))
    assert "2 of its 2 poses lie far from " in note
    assert "behind the camera" in note


def test_rows_out_of_reach_give_no_pose_and_the_others_do(tmp_path: Path) -> None:
    made = make(tmp_path / "boxes")
    near, far = "7,3,5,1,1 0 0 0 1 0 0 0 1,0 0 500,-1", "7,3,5,2,1 0 0 0 1 0 0 0 1,0 0 1e30,-1"
    source = made.open(results(tmp_path, near, far))
    assert "1 row gives no pose: it lies more than 100 m from the camera" in source.notes[0]
    (instance,) = [i for i in source.problem("7/3").instances if i.obj_id == 5]
    assert [h.confidence for h in instance.hypotheses] == [1.0]
    with pytest.raises(InputError, match="every pose lies more than 100 m from the camera"):
        made.open(results(tmp_path, far))
