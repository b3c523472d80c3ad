"""The report as a file: whole, small, and asking nobody for anything."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.made_runs import answer
from tests.report.pages import GONE, figures, fill_cards, size_of_1000_frames, without_plotly
from tests.report.runs import row, write_run
from tests.scenes.bop_folder import box_ply, make
from verefine_viz import cli
from verefine_viz.report.build_report import write_report
from verefine_viz.run.session_file import resolve
from verefine_viz.scenes.demo import demo_problem


@pytest.mark.usefixtures("long_run")
def test_a_large_run_stays_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill_cards(monkeypatch)
    sizes = []
    for n in (50, 100):
        errors = np.random.default_rng(0).gamma(1.0, 8.0, (n, 6))
        rows = [row(k, i, add_s_mm=float(errors[k, i]), score=0.5 + 0.01 * i) for k in range(n) for i in range(6)]
        other = [row(k, i, add_s_mm=float(errors[-k, i]), score=0.4 + 0.01 * i) for k in range(n) for i in range(6)]
        a, b = write_run(tmp_path / f"a{n}", rows, GONE), write_run(tmp_path / f"b{n}", other, GONE)
        write_report(a, b, tmp_path / "report.html")
        html = (tmp_path / "report.html").read_text(encoding="utf-8")
        assert html.count('<article class="entry"') == 60
        sizes.append(len(html.encode()))
    assert size_of_1000_frames(*sizes) < 30e6
    assert len(figures(html)["change"]["data"]) == 4


def test_without_its_data_set_a_report_has_everything_but_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_run(
        tmp_path / "a", [row(1), row(2, add_s_mm=40.0, cause="pool", evidence="All were far off.")], GONE
    )
    assert cli.main(["report", str(folder)]) == 0
    said = capsys.readouterr().out
    assert said.count("No pictures: ") == 1
    assert "No BOP scores: " in said
    html = without_plotly((folder / "report.html").read_text(encoding="utf-8"))
    assert "<img" not in html
    assert "rir got 1 of 2 objects right" in html
    assert "no good hypothesis in the pool" in html
    assert "The only wrong answer of 2 has the cause “no good hypothesis in the pool”" in html
    assert 'begin with <a href="#card-1">object 1 in frame 1/2</a>.' in html
    assert "All were far off." in html
    assert {"recall", "score-1", "times", "causes"} <= figures(html).keys()


def test_it_asks_nobody_for_anything(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "a", [row(1), row(2, add_s_mm=40.0)], GONE)
    write_report(folder, None, tmp_path / "report.html")
    html = without_plotly((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "default-src 'none'" in html
    assert not re.search(r'(?:src|href)="(?!data:|#)', html)


def test_what_files_say_is_text(tmp_path: Path) -> None:
    name = "</script><b>object</b>"
    rows = [row(1, name=name), row(2, name=name, add_s_mm=40.0, cause="odd", evidence="<i>why</i>")]
    write_report(
        write_run(tmp_path / "a", rows, GONE | {"title": "<u>run</u>"}),
        None,
        tmp_path / "r.html",
    )
    html = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert not re.search("<b>object|<i>why|<u>run", html)
    assert any(name in text for text in figures(html)["score-1"]["data"][0]["text"])


def test_without_ground_truth_it_says_so(tmp_path: Path) -> None:
    rows = [row(k, has_truth=False, add_s_mm=None, score=0.1 * k) for k in (1, 2)]
    write_report(write_run(tmp_path / "a", rows, GONE), None, tmp_path / "r.html")
    html = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "without ground truth" in html
    assert "recall" not in figures(html)


def test_a_run_of_failed_frames_only_has_a_report(tmp_path: Path) -> None:
    rows = [answer(scene_id=1, im_id=k, status="failed", message="no depth") for k in (1, 2)]
    write_report(write_run(tmp_path / "a", rows, GONE), None, tmp_path / "r.html")
    assert "2 frames failed as a whole" in (tmp_path / "r.html").read_text(encoding="utf-8")


def test_no_failures_no_gallery(tmp_path: Path) -> None:
    write_report(write_run(tmp_path / "a", [row(1)], GONE), None, tmp_path / "r.html")
    assert "Nothing that could be solved came out wrong." in (tmp_path / "r.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("processes")
def test_with_its_data_a_report_has_pictures_and_bop_scores(tmp_path: Path) -> None:
    session = resolve({})
    instance = demo_problem("mug", session.scene, session.hypotheses).instances[0]
    ids = {"scene_id": 0, "obj_id": instance.obj_id, "add_s_mm": 40.0}
    found = {}
    for name, off_m in (("right", 0.0), ("wrong", 0.3)):
        T_cam_obj = np.array(instance.T_cam_obj_gt)
        T_cam_obj[0, 3] += off_m
        folder = write_run(tmp_path / name, [row(0, instance.instance_id, **ids)], {"title": name}, T_cam_obj)
        assert write_report(folder, None, tmp_path / "r.html") == ()
        html = (tmp_path / "r.html").read_text(encoding="utf-8")
        assert html.count('<img src="data:image/webp;base64,') == 2
        assert "BOP scores over all instances that are at least 10 % visible" in html
        # A made-up run says 1 s for a frame, and nothing about its stages.
        assert re.search(r"solving, a frame</div>\s*<div class=\"value\">1\u202f000 ms", html)
        found[name] = re.search(r"BOP AR</div>\s*<div class=\"value\">([\d.]+) %", html)
    assert float(found["right"][1]) == 100.0
    assert float(found["wrong"][1]) == 0.0


def test_bop_scores_say_that_a_mesh_is_in_another_unit(tmp_path: Path) -> None:
    made = make(tmp_path / "data")
    (made.root / "models" / "obj_000005.ply").write_text(box_ply(made.problem, unit_m=1.0))
    T_gt = made.problem.instances[1].T_cam_obj_gt
    answer = row(3, 1, scene_id=7, obj_id=5)
    session = {"scene": {"source": "bop", "dataset": str(made.root), "objects": [5]}}
    write_report(write_run(tmp_path / "run", [answer], session, T_gt), None, tmp_path / "r.html")
    html = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert re.search(r"BOP AR</div>\s*<div class=\"value\">100.0 %", html)
    assert "Object 5: obj_000005.ply is 0.1414 mm across, models_info.json says 141.4 mm: its unit was taken" in html
