"""What the paper's tables have that the frames at hand do not allow."""

from __future__ import annotations

from pathlib import Path

from verefine_viz.session.files import load_session
from verefine_viz.studies.paper_tables import ROWS, missing_rows


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


def test_what_nobody_can_run_here_says_why(tmp_path: Path) -> None:
    scene = {"source": "bop", "dataset": str(tmp_path / "ycbv")}
    (sentence,) = (s for s in missing_rows([load_session(None, {"scene": scene})]) if "YCB-Video" in s)
    assert "DenseFusion and its refiner are not part of this package" in sentence
    assert "needs the data set" not in sentence
