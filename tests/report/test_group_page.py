"""The page that compares many runs: whole, small, and asking nobody for anything."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.report.pages import GONE, figures, fill_cards, size_of_1000_frames, without_plotly
from tests.report.runs import row, write_run
from verefine_viz import cli


def sweep(folder: Path, methods: tuple[str, ...], n_seeds: int, n_frames: int, n_objects: int = 1) -> Path:
    """Runs of made-up errors; each method is a little worse than the one before it."""
    for k, method in enumerate(methods):
        for seed in range(n_seeds):
            errors = np.random.default_rng(seed).gamma(1.0, 4.0 + 2 * k, (n_frames, n_objects))
            why = {True: {"cause": "pool", "evidence": "All were far off."}, False: {}}
            rows = [
                row(f, i, add_s_mm=float(error), method=method, **why[bool(error >= 10)])
                for (f, i), error in np.ndenumerate(errors)
            ]
            settings = {"method": {"name": method, "seed": seed}, "hypotheses": {"seed": seed}}
            write_run(folder / f"{method}-{seed}", rows, {**GONE, **settings})
    return folder


def test_a_folder_of_runs_is_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = sweep(tmp_path / "runs", ("rir", "sir", "pir", "refine", "even", "expl"), 3, 10)
    (folder / "notes").mkdir()
    run = folder / "pir-2" / "run.json"
    run.write_text(json.dumps({**json.loads(run.read_text()), "status": "stopped"}))
    assert cli.main(["report", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "6 groups, 17 runs, 10 frames." in said
    assert "1 of 18 runs left out" in said
    html = (folder / "report.html").read_text(encoding="utf-8")
    assert {"forest", "recall", "panels", "causes", "times"} <= figures(html).keys()
    plain = without_plotly(html)
    assert "6 methods compared: rir, " in plain
    assert "pir-2: not finished (stopped)" in plain
    assert plain.count('<tr><td class="text name">') == 6
    assert '<select data-by="group"' in plain
    assert "All were far off." in plain
    assert re.search(r"title=\"[^\"]*without first scores; median\"[^>]*>iterations \[ms\]<", plain)
    assert "default-src 'none'" in plain
    assert len(figures(html)["recall"]["data"]) == 6


def test_few_groups_have_their_bands_in_one_chart(tmp_path: Path) -> None:
    folder = sweep(tmp_path / "runs", ("rir", "sir"), 2, 10)
    assert cli.main(["report", str(folder), "--out", str(tmp_path / "r.html")]) == 0
    found = figures((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert "panels" not in found
    assert len(found["recall"]["data"]) == 4


def test_seeds_of_one_method_have_a_report_too(tmp_path: Path) -> None:
    folder = sweep(tmp_path / "runs", ("rir",), 4, 5)
    assert cli.main(["report", str(folder)]) == 0
    plain = without_plotly((folder / "report.html").read_text(encoding="utf-8"))
    assert "against the best" not in plain
    assert "rir gets " in plain
    assert "<h1>rir on all/test, 4 seeds</h1>" in plain


def test_a_folder_with_one_run_gives_its_report(tmp_path: Path) -> None:
    folder = sweep(tmp_path / "runs", ("rir",), 1, 5)
    assert cli.main(["report", str(folder)]) == 0
    assert "rir got " in (folder / "report.html").read_text(encoding="utf-8")


def test_where_the_runs_lie_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sweep(tmp_path / "runs" / "may", ("rir", "sir"), 1, 5)
    assert cli.main(["report", str(tmp_path / "runs")]) == 0
    assert f"The runs in {tmp_path / 'runs/may'} (2 runs)." in capsys.readouterr().out
    assert (tmp_path / "runs" / "report.html").is_file()
    sweep(tmp_path / "runs" / "june", ("pir",), 1, 5)
    assert cli.main(["report", str(tmp_path / "runs")]) == 2
    assert f"name one of them: {tmp_path / 'runs/june'} (1 run: pir-0); " in capsys.readouterr().err


def test_without_ground_truth_it_says_so(tmp_path: Path) -> None:
    for name in ("rir", "sir"):
        rows = [row(k, has_truth=False, add_s_mm=None, score=0.1 * k) for k in (1, 2)]
        write_run(tmp_path / "runs" / name, rows, GONE | {"method": {"name": name}})
    assert cli.main(["report", str(tmp_path / "runs")]) == 0
    html = (tmp_path / "runs" / "report.html").read_text(encoding="utf-8")
    assert "without ground truth it is unknown which is best" in html
    assert not {"recall", "forest"} & figures(html).keys()


@pytest.mark.usefixtures("long_run")
def test_a_large_sweep_stays_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill_cards(monkeypatch)
    sizes = []
    for n in (50, 100):
        folder = sweep(tmp_path / f"runs{n}", ("rir", "sir", "pir"), 2, n, 4)
        assert cli.main(["report", str(folder)]) == 0
        html = (folder / "report.html").read_text(encoding="utf-8")
        assert html.count('<article class="entry"') == 60
        sizes.append(len(html.encode()))
    assert size_of_1000_frames(*sizes) < 30e6


def test_what_files_say_is_text(tmp_path: Path) -> None:
    name = "</script><b>object</b>"
    for method in ("rir", "sir"):
        rows = [row(1, name=name, add_s_mm=40.0, cause="odd", evidence="<i>why</i>")]
        write_run(tmp_path / "runs" / f"<u>{method}<u>", rows, GONE | {"method": {"name": method}})
    assert cli.main(["report", str(tmp_path / "runs")]) == 0
    html = (tmp_path / "runs" / "report.html").read_text(encoding="utf-8")
    assert "<b>object" not in html
    assert "<i>why" not in html
    assert "<u>rir" not in html


def test_data_in_doubt_are_reported_above_all_with_a_run_that_says_so(tmp_path: Path) -> None:
    for name, evidence in (("rir-0", ""), ("sir-0", "Look at the data first: objects look small: check cam_K.")):
        write_run(tmp_path / name, [row(1, evidence=evidence), row(2)], {**GONE, "method": {"name": name[:3]}})
    assert cli.main(["report", str(tmp_path)]) == 0
    said = "Look at the data first: in frame 1/1 of sir-0, objects look small: check cam_K."
    plain = without_plotly((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert f'<p class="bad">{said}</p>' in plain


def test_groups_have_the_share_of_grasps_that_succeed(tmp_path: Path) -> None:
    for method, n_lifted in (("rir", 3), ("sir", 1)):
        ends = ["success"] * n_lifted + ["slipped"] * (4 - n_lifted)
        rows = [row(k, method=method, grasp=end, grasp_ground_truth="success") for k, end in enumerate(ends)]
        write_run(tmp_path / "runs" / method, [*rows, row(9, method=method)], {**GONE, "method": {"name": method}})
    assert cli.main(["report", str(tmp_path / "runs")]) == 0
    html = without_plotly((tmp_path / "runs" / "report.html").read_text(encoding="utf-8"))
    assert "lifted [%]" in html
    shown = {method: re.search(rf">{method}<.*?</tr>", html, re.DOTALL) for method in ("rir", "sir")}
    assert "<b>75</b>" in shown["rir"][0]
    assert ">25<" in shown["sir"][0]
