"""How often the score ranks a wrong answer above a right one."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made_runs import answer
from verefine_viz.batch.totals import misranked_share
from verefine_viz.run.record import Answer

SCORES = st.lists(st.sampled_from([0.1, 0.5, 0.9]), min_size=1, max_size=8)


def rows(scores: list[float], add_s_mm: float) -> list[Answer]:
    return [answer(diameter_mm=100.0, add_s_mm=add_s_mm, score=score) for score in scores]


@given(SCORES, SCORES)
def test_it_is_the_share_of_pairs_and_a_draw_counts_half(right: list[float], wrong: list[float]) -> None:
    pairs = [1.0 if w > r else 0.5 if w == r else 0.0 for w in wrong for r in right]
    assert misranked_share(rows(right, 1.0) + rows(wrong, 50.0)) == pytest.approx(sum(pairs) / len(pairs))


def test_without_pairs_nobody_can_say() -> None:
    assert misranked_share(rows([0.5], 1.0)) is None
    assert misranked_share(rows([0.5], 50.0)) is None
    assert misranked_share([]) is None
