"""Tables I to III: budgets, what of the paper stands beside which row, and how a table is printed."""

from __future__ import annotations

import re
from pathlib import Path

from verefine_viz.core.console import PrintedTable
from verefine_viz.core.presets import WITH_REFINER, preset_fields
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import changed, load_session, resolve
from verefine_viz.studies.budgets import BUDGETS, budget_of
from verefine_viz.studies.paper_tables import PAPER, missing_rows, paper_table, tables
from verefine_viz.studies.printed_table import latex, markdown
from verefine_viz.studies.study_plan import Panel, StudyCurve
from verefine_viz.studies.study_report import printed, printed_paper_table


def _session(tmp_path: Path, dataset: str, source: str) -> Session:
    scene = {"source": "bop", "dataset": str(tmp_path / dataset)}
    return load_session(None, {"scene": scene, "hypotheses": {"source": source}})


def _panel(name: str, own: bool = False) -> Panel:
    return next(panel for panel in tables(own).panels if panel.name == name)


def _curve(panel: str, label: str) -> StudyCurve:
    return next(curve for curve in _panel(panel).curves if curve.label == label)


def test_every_refiner_has_the_papers_budget() -> None:
    sir, alone = _curve("ICP", "SIR, 50").settings, _curve("ICP", "ICP, 150").settings
    assert (sir["method"]["iterations"], sir["icp"]["max_iterations"], sir["icp"]["stop"]) == (5, 10, "max_iterations")
    assert (alone["method"]["iterations"], alone["icp"]["max_iterations"]) == (1, 150)
    df_r = _curve("DF-R", "PIR, 2").settings
    assert (df_r["method"]["iterations"], df_r["densefusion"]["iterations"], df_r["physics"]["steps"]) == (2, 1, 3)
    vf_d = _curve("TrICP", "VF_d, 50").settings
    assert (vf_d["method"]["iterations"], vf_d["method"]["exploration"], vf_d["physics"]["steps"]) == (2, 0.2, 60)
    assert _curve("TrICP", "PHYSIM-MCTS, 50").most_calls == 50


def test_studies_and_preset_paper_have_one_budget_for_each_refiner() -> None:
    assert {*BUDGETS} == {refiner for preset, refiner in WITH_REFINER if preset == "paper"}
    for refiner, budget in BUDGETS.items():
        preset = preset_fields("paper", refiner)
        numbers = (preset["method"]["iterations"], preset["hypotheses"]["max_per_object"], preset["physics"]["steps"])
        assert numbers == (budget.calls, budget.hypotheses, budget.steps), refiner
        inner = preset["icp"].get("max_iterations", 1)
        assert inner == budget.inner, refiner


def test_rows_of_the_papers_refiners_score_by_depth_and_normals_alone() -> None:
    recommended = resolve({"scene": {"demo": "mug"}})
    assert recommended.score.colour_weight > 0
    for refiner in BUDGETS:
        curve = budget_of(refiner).curve("RIR", "rir")
        assert curve.settings is not None
        assert changed(recommended, curve.settings).score.colour_weight == 0


def test_every_row_of_the_paper_has_a_row_of_its_own_budget() -> None:
    for table in PAPER:
        labels = [curve.label for curve in _panel(table.panel).curves]
        assert {row.label for row in table.rows} <= set(labels), table.number


def test_the_papers_numbers_are_those_of_its_text(shared_data: Path) -> None:
    cells = re.sub(r"\\textbf\{([\d.]+)\}", r"\1", (shared_data.parent / "paper.tex").read_text(encoding="utf-8"))
    lines = [re.findall(r"[\d.]+", line.partition("&")[2]) for line in cells.splitlines() if "&" in line]
    for table in PAPER:
        for row in table.rows:
            numbers = [f"{v:.1f}" for v in (row.vsd, row.mspd, row.mssd, row.ar)]
            assert any(line[:4] == numbers and f"{row.time:g}" in line for line in lines), (table.number, row.label)


def test_a_table_is_the_papers_with_its_data_set_and_initial_poses_only(tmp_path: Path) -> None:
    for dataset, source, panel, n_frames, number in (
        ("lm", "ppf", "ICP", 2219, "I"),
        ("lm", "densefusion", "DF-R", 2219, "I"),
        ("ycbv", "densefusion", "DF-R", 900, "III"),
        ("xapc", "pcs", "TrICP", 5, "II"),
        ("lm", "perturb", "ICP", 2219, None),
        ("ycbv", "ppf", "ICP", 2219, None),
        ("lm", "pcs", "TrICP", 2219, None),
        ("lm", "ppf", "ICP", 2, None),
    ):
        table = paper_table(panel, [_session(tmp_path, dataset, source)], n_frames)
        assert (table and table.number) == number, (dataset, source)


def test_why_a_table_is_not_the_papers_names_data_set_frames_or_initial_poses(tmp_path: Path) -> None:
    built_in = missing_rows([load_session(None, {"scene": {"demo": "mug"}})], 1)
    for table, sentence in zip(PAPER, built_in, strict=True):
        assert sentence.startswith(f"Table {table.number}, {table.data}, ")
        assert table.dataset in sentence
    for source, n_frames, named in (("ppf", 2, "its 2219 frames"), ("perturb", 2219, 'source = "ppf"')):
        sentences = missing_rows([_session(tmp_path, "lm", source)], n_frames)
        (sentence,) = (s for s in sentences if s.startswith("Table I, LINEMOD, ICP: "))
        assert named in sentence


def _row(curve: str, n_refined: float) -> dict[str, str | float]:
    of_pose = {"ar_vsd": 0.8, "ar_mssd": 0.8, "ar_mspd": 0.8, "ar": 0.8, "rotation_deg": 5.0, "translation_cm": 1.25}
    return {"panel": "ICP", "curve": curve, **of_pose, "ms_per_object": 9.0, "refiner_calls_per_object": n_refined}


def test_the_papers_number_stands_beside_its_own_budget_and_data_only(tmp_path: Path) -> None:
    numbers = [_row("ICP, 50", 50), _row("RIR, 150", 100), _row("VF_b, 150", 150)]
    theirs = paper_table("ICP", [_session(tmp_path, "lm", "ppf")], 2219)
    for paper, expected in ((theirs, ("88.7", "other budget")), (None, ("other data", "other data"))):
        cells = {row[0]: row[-1] for row in printed(_panel("ICP"), numbers, paper).rows}
        assert (cells["ICP, 50"], cells["RIR, 150"]) == expected
        assert cells["VF_b, 150"] == ""  # the paper has none with ICP


def test_a_row_without_numbers_is_left_open_and_table_ii_has_mean_errors() -> None:
    row = {**_row("RIR, 50", 50), "panel": "TrICP"}
    table = printed(_panel("TrICP"), [row], None)
    assert table.headings == ("", "VSD", "MSPD", "MSSD", "AR", "r̄ [°]", "t̄ [cm]", "T [s]", "#ref", "paper")
    cells = {row[0]: row[1:] for row in table.rows}
    assert cells["RIR, 50"] == ("80.0", "80.0", "80.0", "80.0", "5.0", "1.2", "0.0", "50", "other data")
    assert set(cells["VF_d, 50"][:-1]) == {"–"}
    assert cells["VF_d, 50"][-1] == "see below"


def test_a_sessions_own_refiner_is_a_panel_and_an_estimators_first_pose_a_row_of_its_own() -> None:
    assert [panel.name for panel in tables().panels] == ["DF-R", "ICP", "TrICP"]
    assert [panel.name for panel in tables(refiner="depth_net").panels][-1] == "depth_net"
    for own in (False, True):
        for panel in tables(own).panels:
            assert any(curve.label == "first initial pose" for curve in panel.curves) == own


def test_a_table_is_printed_in_markdown_and_latex() -> None:
    table = PrintedTable(
        "T & co", ("", "AR", "r̄ [°]"), (("VF_b, 2", "1.0", "2"), ("a_b", "–", "3")), {(0, 1): "bold"}, (1,)
    )
    assert markdown(table).splitlines()[2:] == [
        "|  | AR | r̄ [°] |", "| --- | ---: | ---: |", "| VF_b, 2 | **1.0** | 2 |", "| a_b | – | 3 |",
    ]  # fmt: skip
    tex = latex(table)
    assert r" & AR & $\bar{r}$ [$^\circ$] \\" in tex
    assert r"VF$_b$, 2 & \textbf{1.0} & 2 \\" in tex
    assert r"a\_b & -- & 3 \\" in tex
    assert r"T \& co" in tex
    assert tex.count(r"\midrule") == 2


def test_the_papers_tables_are_printed_as_they_are() -> None:
    table = printed_paper_table(PAPER[2])
    assert table.rows[0] == ("PHYSIM-MCTS", "48.5", "51.6", "68.3", "56.2", "5.7", "1.3", "29.9", "50")
