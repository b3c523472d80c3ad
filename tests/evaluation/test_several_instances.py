"""Objects that are in an image more than once: two boxes of one kind, and one of another."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.evaluation import reference
from tests.evaluation.demo_set import T_of
from tests.scenes.bop_folder import Made, make
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import transform
from verefine_viz.evaluation.bop_scores import BopScores, bop_scores
from verefine_viz.evaluation.ground_truth import BopGroundTruth, Task, find_targets, read_targets
from verefine_viz.evaluation.pose_table import pose_table
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.results_csv import ResultRow


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return make(tmp_path)


def scored(made: Made, rows: list[ResultRow], task: Task | None = None) -> BopScores:
    truth = BopGroundTruth(BopDataset(made.root, "test"))
    targets = read_targets(find_targets(made.root, "test"))
    table = pose_table("method", rows)
    scores = bop_scores([table], truth, targets, task)[0]
    if scores.recalls is not None:
        r = scores.recalls
        expected = reference.average_recalls(table, truth, targets)
        assert (r.ar_vsd, r.ar_mssd, r.ar_mspd) == pytest.approx(expected, abs=1e-12)
    return scores


def true_poses(made: Made) -> list[Float]:
    """Left (object 2), middle (5) and right (2)."""
    truth = BopGroundTruth(BopDataset(made.root, "test"))
    return [T_of(t) for t in truth.image(7, 3, with_depth=False).instances]


def row(obj_id: int, score: float, T: Float) -> ResultRow:
    return ResultRow(7, 3, obj_id, score, T)


def moved(T: Float, x_m: float) -> Float:
    return transform(np.eye(3), [x_m, 0, 0]) @ T


def test_each_estimate_takes_the_instance_it_fits_and_two_of_one_find_it_once(made: Made) -> None:
    left, middle, right = true_poses(made)
    scores = scored(made, [row(2, 0.5, right), row(5, 0.1, middle), row(2, 0.9, left)])
    assert scores.recalls.ar == 1.0
    assert [(a.gt_id, a.row) for a in scores.answers] == [(0, 2), (2, 0), (1, 1)]
    left, middle, _ = true_poses(made)
    scores = scored(made, [row(2, 0.5, left), row(2, 0.9, left), row(5, 0.1, middle)])
    assert scores.recalls.ar_mssd == pytest.approx(2 / 3)


def test_the_best_score_chooses_first_and_nothing_is_given_back(made: Made) -> None:
    left, _, right = true_poses(made)
    # The first is nearest to the left one, which the second fits exactly.
    scores = scored(made, [row(2, 0.9, moved(left, 0.002)), row(2, 0.5, left), row(2, 0.4, right)])
    assert scores.recalls.mssd[-1] < 2 / 3
    assert scores.counts.surplus == 1


def test_only_as_many_instances_count_as_are_asked_for(made: Made) -> None:
    left, middle, right = true_poses(made)
    made.edit("../../test_targets_bop19.json", lambda entries: entries[0].update(inst_count=1))
    # The right one is more visible: the left one is no target any more, and cannot be found.
    assert scored(made, [row(2, 1, left), row(5, 1, middle)]).recalls.mssd[0] == 0.5  # pyright: ignore[reportOptionalMemberAccess]
    assert scored(made, [row(2, 1, right), row(5, 1, middle)]).recalls.ar == 1.0  # pyright: ignore[reportOptionalMemberAccess]


def test_detection_counts_every_estimate(made: Made) -> None:
    left, middle, right = true_poses(made)
    everything = [row(2, 0.9, left), row(2, 0.8, right), row(5, 0.7, middle)]
    assert scored(made, everything, "detection").precision.map == 1.0  # pyright: ignore[reportOptionalMemberAccess]
    far = moved(left, 0.5)
    better = scored(made, [*everything, row(2, 0.1, far)], "detection")
    worse = scored(made, [*everything, row(2, 0.99, far)], "detection")
    assert better.precision.map == 1.0  # all was found before it came
    # Object 2: half, then two thirds of the estimates are right; object 5 is found.
    assert worse.precision.map == pytest.approx((2 / 3 + 1) / 2)
    assert worse.precision.n_targets == 3


def test_detection_ignores_what_is_hardly_visible(made: Made) -> None:
    left, middle, right = true_poses(made)
    made.edit("scene_gt_info.json", hide(0))
    missing = scored(made, [row(2, 0.8, right), row(5, 0.7, middle)], "detection")
    found_too = scored(made, [row(2, 0.9, left), row(2, 0.8, right), row(5, 0.7, middle)], "detection")
    for scores in (missing, found_too):
        assert scores.precision.map == 1.0
        assert scores.precision.n_targets == 2


def hide(k: int) -> Callable[[Any], None]:
    return lambda info: info["3"][k].update(visib_fract=0.05)


def test_detection_looks_at_100_estimates_of_an_image(made: Made) -> None:
    left, middle, right = true_poses(made)
    noise = [row(2, 0.9, moved(left, 0.5)) for _ in range(99)]
    scores = scored(made, [*noise, row(2, 0.5, left), row(2, 0.4, right), row(5, 0.3, middle)], "detection")
    assert scores.counts.scored == 100
    assert scores.counts.surplus == 2
    assert scores.precision_by_object[5].map == 0.0
    assert 0 < scores.precision_by_object[2].map < 0.02


def test_detection_needs_no_depth(made: Made) -> None:
    for path in (made.scene / "depth").iterdir():
        path.unlink()
    _, middle, _ = true_poses(made)
    assert scored(made, [row(5, 1, middle)], "detection").precision_by_object[5].map == 1.0
