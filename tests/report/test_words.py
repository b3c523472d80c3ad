"""Numbers as sentences and tables show them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from tests.report.runs import row
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.report.charts import whole_step
from verefine_viz.report.html import breakable
from verefine_viz.report.run_results import LoadedRun
from verefine_viz.report.run_sentences import data_doubts, session_title, signed, title, tone
from verefine_viz.run.session_file import resolve


def test_what_rounds_to_zero_has_no_sign_and_names_break_between_words() -> None:
    values = (0.0, -0.04, 0.04, -0.06, 2.0, -12.34)
    assert [signed(value) for value in values] == ["0.0", "0.0", "0.0", "−0.1", "+2.0", "−12.3"]
    assert breakable("icp.stop max_iterations 0.7 <b>") == "icp.<wbr>stop max_<wbr>iterations 0.7 &lt;b&gt;"


@given(st.floats(allow_nan=True, allow_infinity=True), st.integers(0, 3))
def test_what_shows_as_zero_has_no_colour(value: float, digits: int) -> None:
    shown = signed(value, digits)
    if math.isfinite(value):
        assert (tone(value, digits) == "") == (float(shown.replace("−", "-")) == 0.0)
    else:
        assert tone(value, digits) == ("" if math.isnan(value) else "good" if value > 0 else "bad")


def run(folder: str = "run", label: str = "", **settings: Any) -> LoadedRun:
    return LoadedRun(label, BatchIndex(Path(folder), resolve({"title": "One of many", **settings}), BatchInfo(), ()))


def test_runs_are_called_by_what_differs_and_not_by_the_title_of_their_session() -> None:
    assert title(run(method={"name": "pir"}, scene={"source": "bop", "dataset": "/data/ycbv"})) == "pir on ycbv/test"
    for a, b, said in (
        ({"method": {"name": "pir"}}, {"method": {"name": "rir"}}, "pir (A) against rir (B)"),
        ({}, {"method": {"exploration": 0.2}}, "rir: method.exploration 0.7 (A) against method.exploration 0.2 (B)"),
        ({}, {"preset": "published"}, "rir: recommended (A) against published (B)"),
        ({}, {"method": {"seed": 3}}, "rir: seed 0 (A) against seeds 0, 3 (B)"),
        (
            {"method": {"name": "pir"}, "hypotheses": {"seed": 3}},
            {"method": {"name": "rir"}},
            "pir, seeds 3, 0 (A) against rir, seed 0 (B)",
        ),
        ({}, {"title": "Another"}, "rir: before (A) against after (B)"),
    ):
        assert title(run("before", "A", **a), run("after", "B", **b)) == said, said
    assert session_title([run(), run()]) == "One of many"
    assert session_title([run(), run(title="Another")]) == ""


@given(st.integers(0, 10**6))
def test_counts_have_ticks_at_whole_numbers_and_not_too_many(most: int) -> None:
    step = whole_step(most)
    assert step >= 1
    assert most / step <= 6
    assert step == 1 or most / step > 2


def test_data_in_doubt_are_reported_with_the_run_that_says_so() -> None:
    doubted, fine = run(label="A"), run(label="B")
    rows = (row(1, evidence="The score misleads. Look at the data first: objects look small: check cam_K."), row(2))
    doubted = replace(doubted, index=replace(doubted.index, rows=rows))
    assert data_doubts([doubted, fine]) == ["A: Look at the data first: in frame 1/1, objects look small: check cam_K."]
    assert data_doubts([fine]) == []
