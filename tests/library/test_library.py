"""The library: frames of arrays and of data, runs, single calls, own parts; the same bits as by other ways in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import verefine_viz as vv
from tests.fakes import box_problem
from tests.library.frames import box_file, boxes
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply
from verefine_viz.refiners.registry import REFINERS
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.run_file import read_run_file
from verefine_viz.run.toolbox import Toolbox


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    return box_file(tmp_path)


def test_a_frame_of_arrays_is_solved_and_nothing_is_written(mesh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = {*mesh.parent.rglob("*")}
    monkeypatch.chdir(mesh.parent)
    run = vv.solve(boxes(mesh), "pir")
    answer = run["box 0"]
    assert answer.score is not None
    assert answer.score > 0.5
    assert answer.is_correct
    assert len(run.iterations) == sum(1 for _ in run.iterations)
    assert {*mesh.parent.rglob("*")} == before


def test_stepping_solving_saving_and_batch_give_the_same_bits(mesh: Path, tmp_path: Path) -> None:
    whole = vv.solve(boxes(mesh), {"name": "rir", "seed": 3})
    stepped = vv.step(boxes(mesh), {"name": "rir", "seed": 3})
    assert not stepped.is_done
    for one, other in zip(stepped.iterations, whole.iterations, strict=True):
        assert one.stages[-1].T_cam_obj.tobytes() == other.stages[-1].T_cam_obj.tobytes()
    record = read_run_file(whole.save(tmp_path / "drop.vfrun"))
    assert record.is_complete
    tools = Toolbox(open_session(tmp_path / "drop-frame", {"method": {"name": "rir", "seed": 3}}))
    again = tools.run(tools.problem(tools.frames[0]))
    again.finish()
    for answer, best in zip(whole.answers, again.final_state.best, strict=True):
        assert answer.T_cam_obj is not None
        assert answer.T_cam_obj.tobytes() == best.T_cam_obj.tobytes()
        assert answer.score == best.score.score


def test_a_run_of_arrays_is_shared_and_saved_again(mesh: Path, tmp_path: Path) -> None:
    run = vv.solve(boxes(mesh), "refine")
    for _ in range(2):
        assert run.save(tmp_path / "drop_17.vfrun").is_file()
    assert sorted(path.name for path in tmp_path.glob("drop*")) == ["drop_17-frame", "drop_17.vfrun"]
    run.share(tmp_path / "drop.html", with_scene=False)
    assert (tmp_path / "drop.html").stat().st_size > 100_000
    with pytest.raises(InputError, match=r"expected drop\.vfrun"):
        run.save(tmp_path / "drop.txt")
    (tmp_path / "a-frame").mkdir()
    with pytest.raises(InputError, match="holds something else"):
        run.save(tmp_path / "a.vfrun")


def test_single_calls_are_what_the_engine_does(mesh: Path) -> None:
    frame = boxes(mesh)
    truth = box_problem(n_instances=2).instances[0].T_cam_obj_gt
    assert truth is not None
    away = truth.copy()
    away[:3, 3] += 0.01
    scores = vv.score(frame, "box 0", [away, truth])
    assert scores.score[1] > scores.score[0]
    maps = vv.score_maps(frame, "box 0", truth)
    assert maps.f_d[maps.counted].mean() == pytest.approx(scores.depth_fit[1], abs=1e-6)
    refined = vv.refine(frame, "box 0", away)
    assert refined.shape == (4, 4)
    assert vv.score(frame, "box 0", refined).score[0] > scores.score[0]
    path = vv.settle(frame, "box 0", truth, steps=5)
    assert path.shape == (6, 4, 4)
    assert np.array_equal(path[0], truth)
    assert len(vv.estimate(frame, "box 0", n=2)) <= 2


def test_a_refiner_of_ones_own_is_taken_by_its_name(mesh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(REFINERS, "lifts", None)  # It is gone with the test.

    @vv.refiner("lifts")
    class Lifts:
        def refine(self, target, T_cam_obj, fixed=()):
            lifted = np.array(T_cam_obj)
            lifted[:3, 3] = apply(lifted, np.zeros((1, 3)))[0] + (0, -0.001, 0)
            return lifted

    truth = box_problem(n_instances=2).instances[0].T_cam_obj_gt
    assert truth is not None
    moved = vv.refine(boxes(mesh), "box 0", truth, refiner="lifts")
    assert np.allclose(moved[:3, 3] - truth[:3, 3], (0, -0.001, 0))
    assert vv.solve(boxes(mesh), "refine", refiner="lifts").iterations
    with pytest.raises(InputError, match="another"):
        vv.refiner("icp")(Lifts)
    with pytest.raises(InputError, match="another"):
        vv.verifier("eq_1")(Lifts)  # type: ignore[type-var]
    with pytest.raises(InputError, match="no method hypotheses"):
        vv.estimator("lifts2")(Lifts)  # type: ignore[type-var]


def test_frames_of_data_are_opened_by_path_and_name(mesh: Path, tmp_path: Path) -> None:
    folder = boxes(mesh).save(tmp_path / "runs" / "one")
    opened = vv.open_frame(folder)
    assert opened.objects == boxes(mesh).objects
    run = vv.solve(opened, "refine")
    assert vv.solve(opened, "refine", preset="paper").session.method.refiner == "icp"
    assert run["box 1"].T_cam_obj is not None
    assert [frame.name for frame in vv.open_dataset("mug")][:1] == ["0/0"]
    with pytest.raises(InputError, match="unknown frame '7/7'"):
        vv.open_frame(folder, "7/7")
    with pytest.raises(InputError, match="unknown object 'bix'"):
        run["bix"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unit_m": 1.0}, "unit_m = 1 was given, 0.001 would fit better"),
        ({"mask": None, "poses": None}, "neither a mask nor a pose"),
        ({"scores": [1.0]}, "scores of box"),
        ({"poses": np.eye(3)}, "pose of box"),
        ({"symmetry_axis": (0, 0, 0)}, "expected a direction"),
        ({"name": ""}, "expected a text"),
        ({"mesh": 3}, "expected a PLY"),
    ],
)
def test_what_does_not_fit_is_one_line_where_it_is_given(mesh: Path, change: dict, message: str) -> None:
    problem = box_problem()
    instance = problem.instances[0]
    frame = vv.Frame(problem.observation.camera.K, problem.observation.depth_m)
    poses = np.array([h.T_cam_obj for h in instance.hypotheses])
    given = {"name": "box", "mesh": mesh, "mask": instance.mask, "poses": poses, "unit_m": 0.001} | change
    with pytest.raises(InputError, match=message) as error:
        frame.add(**given)
    assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="has no object to solve"):
        vv.solve(frame)


def test_every_name_is_there_and_typed() -> None:
    stub = (Path(vv.__file__).with_suffix(".pyi")).read_text()
    names = {line.rsplit(" as ", 1)[1] for line in stub.splitlines() if " as " in line}
    assert names == {*vv._HOMES}  # type: ignore[attr-defined]
    assert all(getattr(vv, name).__doc__ for name in names)
    assert {*names, "__version__"} <= {*dir(vv)}
    with pytest.raises(AttributeError, match="has no attribute 'solv'"):
        vv.solv  # type: ignore[attr-defined]  # noqa: B018


def test_what_is_no_frame_no_section_and_no_pose_in_metres_is_one_line(mesh: Path) -> None:
    frame = boxes(mesh)
    far = np.eye(4)
    far[:3, 3] = (0, 0, 600)
    for call, message in (
        (lambda: vv.solve("data"), "frame is 'data', expected one made by"),  # type: ignore[arg-type]
        (
            lambda: vv.solve(frame, iterations=5),
            r"no section of the settings; write method=\{'iterations'",
        ),
        (lambda: vv.solve(frame, scor={}), "did you mean 'score'"),
        (lambda: vv.solve(frame, score=3), "score is 3, expected score="),  # type: ignore[arg-type]
        (lambda: vv.score(frame, "box 0", far), "is it in millimetres"),
        (lambda: vv.refine(frame, "box 0", far), "is it in millimetres"),
        (lambda: vv.score(frame, "box 0", np.zeros((0, 4, 4))), "with N ≥ 1"),
    ):
        with pytest.raises(vv.VerefineError, match=message):
            call()
    assert repr(frame) == "<Frame 'frame', 80×60: box 0, box 1>"
