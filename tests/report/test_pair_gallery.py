"""Cards of two compared runs: what one lost that the other got right, both ways round."""

from __future__ import annotations

import json
from html import unescape
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from tests.report.pages import GONE, without_plotly
from tests.report.runs import row, write_run
from verefine_viz.report.build_report import write_report
from verefine_viz.report.failure_cards import Gallery, pair_gallery, shared_out
from verefine_viz.report.run_results import LoadedRun, load_pair

WRONG = {"add_s_mm": 40.0}
NO_ANSWER = {"status": "no_answer", "add_s_mm": None, "score": None}
A = [row(1, 0, **WRONG), row(1, 1), row(2, 0, add_s_mm=20.0), row(3, 0), row(4, 0, **NO_ANSWER), row(5, 0, **WRONG)]
B = [row(1, 0), row(1, 1, **WRONG), row(2, 0, add_s_mm=50.0), row(3, 0), row(4, 0, **WRONG), row(6, 0)]


def cards(found: Gallery) -> list[tuple[str, str, str]]:
    return [
        (card.pick.group, card.pick.run.label, f"{card.row.frame}#{card.row.instance_id}") for card in found.failures
    ]


def pair(folder: Path) -> tuple[LoadedRun, LoadedRun]:
    return load_pair(write_run(folder / "a", A, GONE), write_run(folder / "b", B, GONE))


def test_what_either_got_wrong_has_a_card_of_the_worse_answer(tmp_path: Path) -> None:
    found = pair_gallery(*pair(tmp_path), 60, lambda done, of: None)
    assert cards(found) == [
        ("both wrong", "A", "1/4#0"),
        ("both wrong", "B", "1/2#0"),
        ("only A wrong", "A", "1/1#0"),
        ("only A wrong", "A", "1/5#0"),
        ("only B wrong", "B", "1/1#1"),
    ]
    assert [card.other.add_s_mm if card.other else None for card in found.failures] == [40.0, 20.0, 2.0, None, 2.0]
    assert [card.pick.remark for card in found.failures] == ["", "", "", "B does not have it", ""]
    assert found.n_more == 0


def test_few_cards_are_shared_out_among_the_kinds(tmp_path: Path) -> None:
    found = pair_gallery(*pair(tmp_path), 3, lambda done, of: None)
    assert {kind for kind, _, _ in cards(found)} == {"only A wrong", "only B wrong", "both wrong"}
    assert found.n_more == 2


def test_without_ground_truth_the_lowest_scores_of_a_are_shown(tmp_path: Path) -> None:
    rows = [row(k, has_truth=False, add_s_mm=None, score=0.1 * k) for k in (3, 1, 2)]
    runs = load_pair(write_run(tmp_path / "a", rows, GONE), write_run(tmp_path / "b", rows, GONE))
    assert [frame for _, _, frame in cards(pair_gallery(*runs, 2, lambda done, of: None))] == ["1/1#0", "1/2#0"]


def test_tables_lead_to_the_cards_and_both_causes_are_reported(tmp_path: Path) -> None:
    a = [row(1, 0, cause="mask", evidence="It leaks.", **WRONG), row(2, 0, add_s_mm=12.0), row(3, 0, add_s_mm=15.0)]
    b = [row(1, 0, cause="pool", evidence="All far off.", add_s_mm=60.0), row(2, 0), row(3, 0, add_s_mm=16.0)]
    folders = [write_run(tmp_path / name, rows, GONE) for name, rows in (("a", a), ("b", b))]
    write_report(folders[0], folders[1], tmp_path / "r.html", most_failures=2)
    html = without_plotly((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert '<a href="#card-1">1/1</a>' in html
    card = unescape(html[html.index('<article class="entry" id="card-1"') :].partition("\n")[0])
    causes = ["no good hypothesis in the pool", "mask leaks or misses"]
    assert f'"cause": {json.dumps(causes)}' in card
    assert '"group": ["both wrong"]' in card
    assert "B 60.0 mm · A 40.0 mm" in html
    assert html.index("All far off.") < html.index("It leaks.")
    assert '<a href="#card-2">1/2</a>' in html
    assert '<td class="text">1/3</td>' in html
    assert "2 objects that one run or both got wrong, worst first: 1 only A wrong, 1 both wrong; 1 more in" in html


@given(st.integers(0, 40), st.lists(st.integers(0, 20), min_size=1, max_size=4))
def test_shares_are_even_and_use_what_is_there(most: int, sizes: list[int]) -> None:
    shares = shared_out(most, sizes)
    assert sum(shares) == min(most, sum(sizes))
    assert all(share <= size for share, size in zip(shares, sizes, strict=True))
    short = [share for share, size in zip(shares, sizes, strict=True) if share < size]
    assert not short or max(shares) - min(short) <= 1
