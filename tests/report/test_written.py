"""The report as a file: whole, small, the same again, and with nothing from elsewhere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.made_runs import answer, because
from tests.report.pages import GONE, messages, parts, report, section
from tests.report.runs import row, write_run
from verefine_viz import cli
from verefine_viz.page.thumbnails import Painter
from verefine_viz.report.report_tools import report_tools
from verefine_viz.report.write_report import write_report
from verefine_viz.run.session_file import resolve
from verefine_viz.scenes.demo import demo_problem


def sweep(folder: Path, methods: tuple[str, ...], n_seeds: int, n_frames: int, n_objects: int = 1) -> Path:
    """Runs of made-up errors; each method is a little worse than the one before it."""
    for k, method in enumerate(methods):
        for seed in range(n_seeds):
            errors = np.random.default_rng(seed).gamma(1.0, 4.0 + 2 * k, (n_frames, n_objects))
            why = {True: because("pool", "All were far off."), False: ()}
            rows = [
                row(f, i, add_s_mm=float(error), method=method, findings=why[bool(error >= 10)])
                for (f, i), error in np.ndenumerate(errors)
            ]
            settings = {"method": {"name": method, "seed": seed}, "hypotheses": {"seed": seed}}
            write_run(folder / f"{method}-{seed}", rows, {**GONE, **settings})
    return folder


def made(*words: object) -> Path:
    """Write a report by the command, and return the file."""
    assert cli.main(["report", *map(str, words)]) == 0
    first = Path(str(words[0]))
    return max(first.glob("report*.html"), key=lambda path: path.stat().st_mtime)


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """The one line with which these words are refused."""
    assert cli.main(["report", *map(str, words)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    return lines[0]


def test_what_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty, run = write_run(tmp_path / "a", []), write_run(tmp_path / "b", [row(1)])
    (tmp_path / "none").mkdir()
    for folder in (tmp_path / "none", tmp_path / "nowhere", empty):
        assert str(folder) in refused(capsys, folder)
    assert str(run) in refused(capsys, run, run)
    assert str(tmp_path) in refused(capsys, run, "--out", tmp_path)


def test_without_its_data_set_a_report_has_everything_but_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_run(
        tmp_path / "a", [row(1), row(2, add_s_mm=40.0, findings=because("pool", "All were far off."))], GONE
    )
    path = made(folder)
    said = capsys.readouterr().out
    assert all(said.count(lack) == 1 for lack in ("No pictures: ", "cannot be opened in the report: ", "No BOP scores"))
    only = section(path)
    assert (only["next"]["key"], only["next"]["begin"]) == (1, "object 1 in frame 1/2")
    (group,) = only["groups"]
    assert group["causes"] == [["no good hypothesis in the pool", 1]]
    assert group["curve"]["recall"][20] == 50.0
    rows = messages(path)["answers"]["rows"]
    assert [(r["result"], r["thumb"], r["part"]) for r in rows] == [
        ("right", False, None), ("wrong or no answer", False, None)
    ]  # fmt: skip
    assert rows[1]["evidence"] == "All were far off."
    assert rows[1]["command"] == "verefine-viz view a/runs/000001_000002.vfrun"


def test_the_same_runs_make_the_same_file(tmp_path: Path) -> None:
    folder = sweep(tmp_path / "runs", ("rir", "sir"), 2, 5)
    assert made(folder).read_bytes() == made(folder, "--workers", 1).read_bytes()


def test_what_files_say_is_text(tmp_path: Path) -> None:
    name = "</script><b>object</b>"
    for method in ("rir", "sir"):
        rows = [row(1, name=name, add_s_mm=40.0, findings=because("odd", "<!--why"))]
        write_run(tmp_path / "runs" / method, rows, GONE | {"title": "<u>run</u>", "method": {"name": method}})
    path = made(tmp_path / "runs")
    html = path.read_text("utf-8")
    assert not any(markup in html for markup in ("<b>object", "<!--why", "<u>run"))
    assert section(path)["objects"][0]["name"] == name
    assert report(path)["session_title"] == "<u>run</u>"


def test_a_folder_of_runs_is_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = sweep(tmp_path / "runs", ("rir", "sir", "pir", "refine"), 3, 10)
    (folder / "notes").mkdir()
    run = folder / "pir-2" / "run.json"
    run.write_text(json.dumps({**json.loads(run.read_text()), "status": "stopped"}))
    path = made(folder)
    said = capsys.readouterr().out
    assert "pir, refine, rir and sir on all/test: 4 groups, 11 runs, 10 frames." in said
    assert "1 of 12 runs left out" in said
    assert report(path)["left_out"] == [["pir-2", "not finished (stopped)"]]
    only = section(path)
    assert [group["name"] for group in only["groups"]] == ["pir", "refine", "rir", "sir"]
    assert only["best"] == 2
    assert only["change"] is None
    assert only["differing"] == [["method.name", ["pir", "refine", "rir", "sir"]]]
    assert {r["group"] for r in messages(path)["answers"]["rows"]} == {"pir", "refine", "rir", "sir"}


def test_two_runs_of_one_name_are_told_apart(tmp_path: Path) -> None:
    runs = [write_run(tmp_path / parent / "run", [row(1, add_s_mm=e)], GONE) for parent, e in (("a", 1.0), ("b", 40.0))]
    path = made(*runs)
    assert path.name == "report-against-run.html"
    assert [[o["turned"] for o in section(path)["change"]["objects"]]] == [["wrong"]]
    assert [r["run"] for r in messages(path)["answers"]["rows"]] == [str(run) for run in runs]
    assert [r["compared"].partition(" ")[0] for r in messages(path)["answers"]["rows"]] == ["only", "only"]


def test_without_ground_truth_it_says_so(tmp_path: Path) -> None:
    rows = [row(k, has_truth=False, add_s_mm=None, score=0.1 * k) for k in (2, 1)]
    for name in ("rir", "sir"):
        write_run(tmp_path / "runs" / name, rows, GONE | {"method": {"name": name}})
    only = section(made(tmp_path / "runs"))
    assert not only["has_truth"]
    assert only["change"] is None
    assert all(group["curve"] is None for group in only["groups"])
    assert only["bop"] == ""


def test_a_run_of_failed_frames_only_has_a_report(tmp_path: Path) -> None:
    rows = [answer(scene_id=1, im_id=k, status="failed", message="no depth") for k in (1, 2)]
    only = section(made(write_run(tmp_path / "a", rows, GONE)))
    assert only["headline"] == "0 objects in 2 frames; 2 frames failed."
    assert only["groups"][0]["numbers"] == {}


def test_data_in_doubt_come_first_with_a_run_that_says_so(tmp_path: Path) -> None:
    for name, doubts in (("rir-0", ()), ("sir-0", ("objects look small: check cam_K",))):
        write_run(tmp_path / name, [row(1, doubts=doubts), row(2)], {**GONE, "method": {"name": name[:3]}})
    said = "Look at the data first: in frame 1/1 of sir-0, objects look small: check cam_K."
    assert section(made(tmp_path))["doubt"] == said


def test_grasps_are_counted_by_how_they_end(tmp_path: Path) -> None:
    ends = ("success", "slipped", "collided with a neighbour", "slipped")
    rows = [row(k, grasp=end, grasp_ground_truth="success", add_s_mm=40.0) for k, end in enumerate(ends)]
    (group,) = section(made(write_run(tmp_path / "a", rows, GONE)))["groups"]
    assert group["grasps"] == [["success", 1, 4], ["slipped", 2, 0], ["collided with a neighbour", 1, 0]]
    assert group["numbers"]["lifted"][0] == 25.0


def test_a_large_run_stays_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The largest picture: noise is what compresses worst.
    picture = np.random.default_rng(0).integers(0, 256, 20_000, np.uint8).tobytes()
    monkeypatch.setattr(Painter, "__call__", lambda *_: picture)
    sizes = []
    for n in (50, 100):
        errors = np.random.default_rng(0).gamma(1.0, 8.0, (n, 6))
        rows = [row(k, i, add_s_mm=float(errors[k, i]), score=0.5) for k in range(n) for i in range(6)]
        path = made(write_run(tmp_path / f"a{n}", rows, GONE), "--pictures", 100)
        assert len(parts(path, "/thumb/")) == 100
        shown = [r for r in messages(path)["answers"]["rows"] if r["thumb"]]
        assert min(r["err"] for r in shown) >= np.sort(errors.ravel())[-100]
        sizes.append(path.stat().st_size)
    # Of 1000 frames with 6 objects each.
    assert sizes[1] + 900 * (sizes[1] - sizes[0]) / 50 < 12e6


@pytest.mark.usefixtures("processes")
def test_with_its_data_a_report_has_pictures_bop_scores_and_what_went_wrong(tmp_path: Path) -> None:
    session = resolve({})
    instance = demo_problem("mug", session.scene, session.hypotheses).instances[0]
    ids: dict[str, Any] = {"scene_id": 0, "obj_id": instance.obj_id}
    found = {}
    for name, off_m in (("right", 0.0), ("wrong", 0.3)):
        T_cam_obj = np.array(instance.T_cam_obj_gt)
        T_cam_obj[0, 3] += off_m
        error = {"add_s_mm": 1e3 * off_m}
        folder = write_run(tmp_path / name, [row(0, instance.instance_id, **ids, **error)], {"title": name}, T_cam_obj)
        path = tmp_path / f"{name}.html"
        assert write_report([folder], path, report_tools()).notes == ()
        assert parts(path, "/thumb/") == ["0"]
        assert section(path)["bop"].startswith("BOP scores over all instances that are at least 10 % visible")
        found[name] = section(path)["groups"][0]["numbers"]["ar"][0]
    assert found == {"right": 100.0, "wrong": 0.0}
