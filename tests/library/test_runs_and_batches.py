"""Runs and batches that are opened again, as tables, pickled and shown; meshes in memory; live frames."""

from __future__ import annotations

import csv
import pickle
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

import verefine_viz as vv
from tests.fakes import box_problem
from tests.library.frames import box_file, boxes
from verefine_viz import cli
from verefine_viz.core.errors import InputError
from verefine_viz.run.answers import COLUMNS
from verefine_viz.run.record import Answer

PIR = {"name": "pir", "iterations": 2}
QUIET: dict[str, Any] = {"recording": {"keep": "none"}, "progress": False}


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    return box_file(tmp_path)


def bits(run: vv.Run) -> list[tuple[bytes, float | None]]:
    """Poses and scores of all stages of a run, and of its answers."""
    stages = [stage for iteration in run.iterations for stage in iteration.stages]
    made = [(stage.T_cam_obj.tobytes(), None if stage.score is None else stage.score.score) for stage in stages]
    return made + [(np.array(one.T_cam_obj).tobytes(), one.score) for one in run.answers]


def test_a_run_that_is_opened_or_pickled_is_the_run(mesh: Path, tmp_path: Path) -> None:
    run = vv.solve(boxes(mesh), PIR)
    opened = vv.open_run(run.save(tmp_path / "a.vfrun"))
    unpickled = pickle.loads(pickle.dumps(run))
    for other in (opened, unpickled):
        assert bits(other) == bits(run)
        assert [*other] == [*run] == ["box 0", "box 1"]
        assert repr(other["box 1"]) == repr(run["box 1"])
        assert other.is_done
        assert other.allowed("box 0").extents[0].low == run.allowed("box 0").extents[0].low
    assert unpickled.frame.objects == opened.frame.objects == run.frame.objects
    again = vv.solve(opened.frame, PIR)
    assert bits(again) == bits(run)
    with pytest.raises(InputError, match="is a run; open it by open_run"):
        vv.open_frame(tmp_path / "a.vfrun")
    with pytest.raises(InputError, match="no run; expected"):
        vv.open_run(mesh)


def test_a_run_is_a_mapping_of_answers_and_its_iterations_are_made_on_the_way(mesh: Path) -> None:
    run = vv.step(boxes(mesh), PIR)
    assert (len(run), [*run], "box 0" in run, "box 2" in run) == (2, ["box 0", "box 1"], True, False)
    assert (len(run.iterations), run.get("box 2")) == (0, None)
    first = next(iter(run.iterations))
    assert (len(run.iterations), run.iterations[-1]) == (1, first)
    assert len([*run.iterations]) == len(run.iterations) == 4
    assert {name: answer.name for name, answer in run.items()} == {"box 0": "box 0", "box 1": "box 1"}
    assert run[np.int64(1)] is run["box 1"]  # type: ignore[index]
    assert run != vv.step(boxes(mesh), PIR)
    with pytest.raises(IndexError, match="4 were made"):
        run.iterations[4]


def test_what_a_notebook_shows_is_short(mesh: Path) -> None:
    run = vv.solve(boxes(mesh), PIR)
    assert max(len(repr(one)) for one in (run, run["box 0"], run.iterations[0], run.record())) < 120
    assert run._repr_html_().count("data:image/webp") == 2
    assert "data:image/webp" in run["box 0"]._repr_html_()  # type: ignore[attr-defined]
    assert "data:image" not in vv.step(boxes(mesh), PIR)._repr_html_()


def test_a_table_has_numbers_that_may_be_unknown(mesh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = vv.solve(boxes(mesh, T_cam_obj_gt=None), PIR)
    monkeypatch.setattr("verefine_viz.library.tables.find_spec", lambda name: None)
    columns = run.to_frame()
    assert columns["name"] == ["box 0", "box 1"]
    assert columns["right"] == columns["add_s_mm"] == [None, None]
    assert {*Answer.__struct_fields__, "scene_id", "im_id", "right", "cause"} <= columns.keys()
    made: dict[str, Any] = {}
    pandas = SimpleNamespace(
        DataFrame=lambda columns: made.update(columns) or "a frame",
        Series=lambda values, dtype=None: values,
        array=lambda values, dtype: (dtype, values),
    )
    monkeypatch.setitem(sys.modules, "pandas", pandas)
    monkeypatch.setattr("verefine_viz.library.tables.find_spec", lambda name: pandas)
    assert run.to_frame() == "a frame"
    assert made["score"].dtype == made["add_s_mm"].dtype == np.float64
    assert np.isnan(made["add_s_mm"]).all()
    assert made["right"] == ("boolean", [None, None])
    assert made["n_iterations"] == [2, 2]


@pytest.mark.usefixtures("processes")
def test_a_batch_has_the_tables_of_the_command(mesh: Path, tmp_path: Path) -> None:
    frames = [boxes(mesh), boxes(mesh, n=1)]
    batch = vv.batch(frames, tmp_path / "own", method=PIR, **QUIET)  # type: ignore[arg-type]
    words = ["batch", str(tmp_path / "own-frames"), "--out", str(tmp_path / "cli"), "--workers", "1"]
    words += ["--method.name", "pir", "--method.iterations", "2", "--recording.keep", "none"]
    assert cli.main(words) == 0

    def text(name: str) -> str:
        return (tmp_path / name / "frames.csv").read_text()

    exact = [column.name for column in COLUMNS if column.kind == "exact"]
    own, theirs = (
        [[row[name] for name in exact] for row in csv.DictReader(text(name).splitlines())] for name in ("own", "cli")
    )
    assert own == theirs
    opened = vv.open_batch(tmp_path / "own" / "runs")
    assert [*opened.runs] == ["0/1", "0/2"]
    assert bits(opened.runs["0/2"]) == bits(vv.solve(boxes(mesh, n=1), PIR))
    assert [one.name for one in opened.answers] == ["box 0", "box 1", "box 0"]
    assert [one for one in opened.answers if one.is_failure] == [*opened.failures]
    assert vv.batch(tmp_path / "own-frames", batch.folder.with_name("cli"), 1, PIR, **QUIET).notes == ()  # type: ignore[arg-type]
    report = vv.report(batch, opened.folder.with_name("cli"), embed=0, progress=False)
    assert report.path.stat().st_size > 50_000
    with pytest.raises(InputError, match="frames of arrays begin a batch of their own"):
        vv.batch(frames, tmp_path / "own", **QUIET)
    with pytest.raises(InputError, match="is a batch; open it by open_batch"):
        vv.open_frame(batch)


@pytest.mark.usefixtures("processes")
def test_opened_frames_are_solved_together(tmp_path: Path) -> None:
    first, *_ = vv.open_dataset("mug")
    batch = vv.batch([first], tmp_path / "out", method={"name": "refine", "iterations": 1}, **QUIET)
    assert [*batch.runs] == [first.name]
    assert batch.session.scene.demo == "mug"


def test_a_mesh_in_memory_is_the_mesh_of_the_file(mesh: Path, tmp_path: Path) -> None:
    loaded: Any = trimesh.load(mesh, process=False)
    colours = np.full((len(loaded.vertices), 3), 90, np.uint8)
    of_file = vv.solve(boxes(mesh), PIR)
    for given in (loaded, (loaded.vertices, loaded.faces), (loaded.vertices, loaded.faces, colours)):
        run = vv.solve(boxes(given, unit_m=np.float64(0.001)), PIR)
        assert bits(run) == bits(of_file)
    run.save(tmp_path / "coloured.vfrun")
    opened = vv.open_frame(tmp_path / "coloured-frame")
    assert bits(vv.solve(opened, PIR)) == bits(of_file)
    (model,) = {id(one.model): one.model for one in opened.problem().targets[:1]}.values()
    assert (np.asarray(model.vertex_colors) == 90).all()
    for wrong in ((loaded.vertices, loaded.faces + 99), (loaded.vertices,), trimesh.PointCloud(loaded.vertices), 3):
        with pytest.raises(InputError, match="mesh of box 0"):
            boxes(wrong)


def test_a_trace_takes_a_mesh_in_memory(mesh: Path, tmp_path: Path) -> None:
    loaded: Any = trimesh.load(mesh, process=False)
    problem = box_problem()
    seen, (instance,) = problem.observation, problem.instances
    for k, given in enumerate((mesh, loaded, (loaded.vertices, loaded.faces))):
        with vv.Trace(tmp_path / f"t{k}", seen.camera.K, seen.depth_m) as trace:
            one = trace.object("box", given, instance.mask, unit_m=np.float64(0.001))  # type: ignore[arg-type]
            one.hypothesis(0, instance.hypotheses[0].T_cam_obj)
        assert trace.n_problems == 0
    models = [vv.open_frame(tmp_path / f"t{k}").problem().targets[0].model for k in range(3)]
    assert len({model.mesh_hash for model in models}) == 1


def test_the_next_image_of_a_camera_is_solved_as_a_new_frame_is(mesh: Path) -> None:
    first = boxes(mesh)
    vv.solve(first, PIR)
    problem = box_problem(n_instances=2)
    seen = problem.observation
    poses = [np.array([h.T_cam_obj for h in one.hypotheses]) for one in problem.instances]
    masks = {f"box {k}": one.mask for k, one in enumerate(problem.instances)}
    following = first.again(seen.depth_m, seen.rgb, masks, {f"box {k}": T for k, T in enumerate(poses)})
    assert bits(vv.solve(following, PIR)) == bits(vv.solve(boxes(mesh), PIR))
    assert first.again(seen.depth_m, masks={"box 1": masks["box 1"]}).objects == ("box 1",)
    with pytest.raises(InputError, match="unknown object 'box 7'"):
        first.again(seen.depth_m, masks={"box 7": masks["box 1"]})
