"""Groups beside each other: numbers, the best one, hard objects, and the headline."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.changing import replace
from tests.made_runs import answer
from tests.report.runs import row
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.report.bop_recalls import FrameRecalls
from verefine_viz.report.failure_cards import group_gallery
from verefine_viz.report.group_comparison import Comparison, compare
from verefine_viz.report.group_sentences import counted, headline, title
from verefine_viz.report.groups import Group
from verefine_viz.report.object_results import axes_of, by_frame, hardest, heat, outcomes_of
from verefine_viz.report.run_results import LoadedRun, recall_curve
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import resolve

WRONG = {"add_s_mm": 40.0}
NO_ANSWER = {"status": "no_answer", "add_s_mm": None, "score": None}


def run(method: str, seed: int, *rows: Answer) -> LoadedRun:
    session = resolve({"method": {"name": method, "seed": seed}, "hypotheses": {"seed": seed}})
    return LoadedRun("", BatchIndex(Path(f"{method}-{seed}"), session, BatchInfo(), rows))


def group(method: str, *rows_by_seed: tuple[Answer, ...]) -> Group:
    return Group(method, tuple(run(method, seed, *rows) for seed, rows in enumerate(rows_by_seed)))


def frames(n: int, wrong: tuple[int, ...] = (), **values: Any) -> tuple[Answer, ...]:
    return tuple(row(k, **(values | (WRONG if k in wrong else {}))) for k in range(n))


def compared(*groups: Group) -> Comparison:
    return compare(groups, FrameRecalls(note="No BOP scores."))


def test_the_best_group_comes_first_and_the_others_are_measured_against_it() -> None:
    found = compared(group("pir", frames(20, tuple(range(10)))), group("rir", frames(20, (3,))))
    assert [line.name for line in found.lines] == ["rir", "pir"]
    best, other = found.lines
    assert best.behind is None
    assert (best.recall.value, other.behind.value) == pytest.approx((0.95, -0.45))
    assert other.behind.is_clear
    said = headline(found)
    assert said.startswith("rir gets 95.0 % of the objects right (95 %: ")
    assert "the best, 45.0 points more than pir (95 %: " in said
    assert (title(found), counted(found)) == ("2 methods compared: rir and pir", "2 groups, 2 runs, 20 frames")


def test_a_difference_within_the_noise_is_said_to_be_one() -> None:
    found = compared(
        group("pir", frames(20, (1, 2))), group("rir", frames(20, (3,))), group("sir", frames(20, tuple(range(15))))
    )
    assert headline(found).startswith("No group is clearly best. rir gets 95.0 % ")
    assert "pir differs within the noise, pir by −5.0 points" in headline(found)
    assert headline(found).endswith("Clearly behind: sir.")


def test_the_same_answers_or_share_are_no_difference() -> None:
    found = compared(group("rir", frames(5, (1,)), frames(5)), group("vf_breadth", frames(5, (1,)), frames(5)))
    behind = found.lines[1].behind
    assert (behind.value, behind.low, behind.high) == (0.0, 0.0, 0.0)
    assert headline(found).startswith("All 2 groups get the same share of the objects right: ")
    found = compared(group("rir", frames(1)), group("sir", frames(1)))
    assert headline(found) == "All 2 groups get the same share of the objects right: 100.0 %."


def test_groups_with_more_seeds_are_compared_over_the_seeds_of_both() -> None:
    hard = frames(10, tuple(range(10)))
    found = compared(group("pir", frames(10, (1,)), hard), group("rir", frames(10)))
    assert found.lines[1].recall.value == pytest.approx(0.45)
    assert found.lines[1].behind.value == pytest.approx(-0.1)


def test_one_frame_and_one_seed_have_no_interval() -> None:
    found = compared(group("pir", frames(1, (0,))), group("rir", frames(1)))
    assert found.lines[0].recall.low is None
    assert "say nothing about how certain that is" in headline(found)


def test_without_ground_truth_nobody_is_best() -> None:
    rows = frames(4, has_truth=False, add_s_mm=None)
    found = compared(group("sir", rows), group("rir", rows))
    assert not found.has_truth
    assert "without ground truth it is unknown which is best" in headline(found)
    assert found.lines[0].score is not None


def test_columns_say_what_the_rows_do() -> None:
    rows = (row(1, 0), row(1, 1, **WRONG), row(2, 0, **NO_ANSWER), row(3, 0, add_s_mm=9.9, n_iterations=5))
    groups = [group("rir", rows, rows[:2])]
    mine = outcomes_of(groups[0], axes_of(groups))
    n = mine.recall.n.sum()
    assert (mine.recall.total.sum(), n) == (3, 6)
    assert mine.cells(mine.add_s_mm).mean == pytest.approx(np.mean([2, 40, 9.9, 2, 40]))
    assert mine.cells(mine.calls).mean == pytest.approx(np.mean([25, 25, 5, 25, 25]))
    assert sorted(mine.frame_times[0]) == [40.0, 40.0, 80.0, 80.0]
    assert mine.hits.sum(axis=(0, 1)) / n == pytest.approx(recall_curve([*rows, *rows[:2]]))


def test_scenes_are_drawn_where_there_are_many() -> None:
    few = axes_of([group("rir", tuple(row(k, scene_id=k % 3) for k in range(9)))])
    many = axes_of([group("rir", tuple(row(k, scene_id=k % 9) for k in range(18)))])
    assert (few.by_scene, few.shape) == (False, (9, 1))
    assert (many.by_scene, many.shape) == (True, (9, 1))


def test_failed_frames_count_apart_and_search_trees_do_not_count_refiner_calls() -> None:
    failed = answer(scene_id=1, im_id=9, status="failed", message="no depth")
    line = compared(group("rir", (row(1), failed))).lines[0]
    assert (line.n_failed_frames, line.n_objects) == (1, 1)
    assert compared(group("physim_mcts", frames(2))).lines[0].calls is None


def test_recall_by_object_and_group() -> None:
    pir = group("pir", (row(1, 0, **WRONG), row(1, 1)), (row(1, 0), row(1, 1)))
    rir = group("rir", (row(1, 0),))
    first, second = heat([pir, rir])
    assert (first.obj_id, first.total.value) == (1, pytest.approx(2 / 3))
    assert [share.value for share in first.by_group] == [0.5, 1.0]
    assert [share.value for share in second.by_group] == [1.0, None]


def test_hard_is_what_most_groups_get_wrong_with_most_seeds() -> None:
    always = row(1, 0, cause="pool", **WRONG)
    sometimes = row(1, 1, **WRONG), row(1, 1), row(1, 1)
    groups = [
        group(name, *((always, other) if name != "rir" else (row(1, 0), other) for other in sometimes))
        for name in ("pir", "sir", "rir")
    ]
    (hard,) = hardest(by_frame(groups).values())
    assert (hard.frame, hard.row.instance_id, hard.wrong_groups) == ("1/1", 0, 2)
    assert (hard.best[0], hard.cause, hard.total.n) == ("rir", "pool", 9)


def test_the_gallery_takes_as_many_of_each_group_and_an_object_once() -> None:
    worse = frames(4, (0, 1)), (row(0, add_s_mm=60.0), *frames(4, (2,))[1:])
    worse = tuple(tuple(replace(r, cause="pool") if r.add_s_mm != 2.0 else r for r in mine) for mine in worse)
    found = group_gallery([group("pir", *worse), group("rir", frames(4, (3,)))], 4, lambda done, of: None)
    assert [(card.pick.group, card.row.im_id, card.row.add_s_mm) for card in found.failures] == [
        ("pir", 0, 60.0),
        ("pir", 1, 40.0),
        ("rir", 3, 40.0),
    ]
    assert found.failures[0].pick.remark == "pir-1 (seed 1) · wrong in 2 of 2 runs: no good hypothesis in the pool 2"
    assert found.n_more == 2
