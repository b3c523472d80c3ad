"""What the paper's tables have that the frames at hand do not allow."""

from __future__ import annotations

from pathlib import Path

from verefine_viz.run.session_file import load_session
from verefine_viz.studies.paper_tables import PAPER_AR, ROWS, missing_rows, tables


def test_built_in_scenes_make_none_of_the_papers_rows_and_each_reason_names_the_data_set() -> None:
    found = missing_rows([load_session(None, {"scene": {"demo": "mug"}})])
    assert len(found) == len(ROWS)
    for rows, sentence in zip(ROWS, found, strict=True):
        assert sentence.startswith(f"Table {rows.table}, {rows.data}, ")
        assert f"needs the data set {rows.dataset}, these are built-in scenes" in sentence


def test_rows_are_there_with_their_data_set_and_initial_poses(tmp_path: Path) -> None:
    scene = {"source": "bop", "dataset": str(tmp_path / "lm")}
    session = load_session(None, {"scene": scene, "hypotheses": {"source": "ppf"}})
    assert not any("PPF with ICP" in sentence for sentence in missing_rows([session]))
    disturbed = load_session(None, {"scene": scene})
    (sentence,) = (s for s in missing_rows([disturbed]) if "PPF with ICP" in s)
    assert 'needs initial poses by point pair features (source = "ppf"), these are disturbed ground truth' in sentence
    assert "needs the data set" not in sentence


def test_rows_with_densefusion_need_its_initial_poses(tmp_path: Path) -> None:
    scene = {"source": "bop", "dataset": str(tmp_path / "ycbv")}
    (sentence,) = (s for s in missing_rows([load_session(None, {"scene": scene})]) if "YCB-Video" in s)
    assert 'needs initial poses by DenseFusion (source = "densefusion")' in sentence
    assert "needs the data set" not in sentence
    theirs = load_session(None, {"scene": scene, "hypotheses": {"source": "densefusion"}})
    assert not any("YCB-Video" in s for s in missing_rows([theirs]))


def test_a_sessions_own_refiner_gets_rows_as_well() -> None:
    labels = {
        refiner: [c.label for c in tables(refiner=refiner).panels[0].curves] for refiner in ("icp", "densefusion")
    }
    assert not any("DF-R" in label for label in labels["icp"])
    more = [label for label in labels["densefusion"] if label not in labels["icp"]]
    assert [label for label in more if label.endswith(", 2")] == [
        "DF-R, 2", "DF-R + PIR, 2", "DF-R + SIR, 2", "DF-R + RIR, 2", "DF-R + VF_b, 2", "DF-R + VF_d, 2",
    ]  # fmt: skip
    assert len(more) == 12


def test_the_papers_numbers_stand_beside_rows_that_there_are() -> None:
    labels = {curve.label for curve in tables(refiner="densefusion").panels[0].curves}
    assert labels >= PAPER_AR.keys()
    methods = Path(__file__).parents[2] / "docs" / "methods.md"
    numbers = methods.read_text(encoding="utf-8").partition("### 8.3")[2].partition("### 8.4")[0]
    for text in PAPER_AR.values():
        assert all(number == "-" or number in numbers for number in text.split(" / "))


def test_an_estimators_first_pose_is_a_row_of_its_own() -> None:
    for own in (False, True):
        labels = [curve.label for curve in tables(own_initial_poses=own).panels[0].curves]
        assert ("first initial pose" in labels) == own
