"""Average recalls on built-in scenes that were written out as a BOP folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.evaluation import demo_set, reference
from tests.evaluation.demo_set import DemoSet, T_of, disturbed, perfect, table
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.evaluation.bop_scores import BopScores, bop_scores
from verefine_viz.evaluation.ground_truth import ProblemGroundTruth, Targets, visible_targets
from verefine_viz.evaluation.matched_estimates import correct_share, mean_errors
from verefine_viz.evaluation.pose_table import OwnPart, PoseTable
from verefine_viz.scenes.results_csv import ResultRow

pytestmark = pytest.mark.usefixtures("long_run")


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> DemoSet:
    return demo_set.make(tmp_path_factory.mktemp("bop") / "demo")


def scored(demo: DemoSet, rows: Sequence[ResultRow] | PoseTable) -> BopScores:
    given = rows if isinstance(rows, PoseTable) else table(rows)
    return bop_scores([given], demo.truth, demo.targets)[0]


def numbers(scores: BopScores) -> tuple[float, float, float]:
    return scores.recalls.ar_vsd, scores.recalls.ar_mssd, scores.recalls.ar_mspd


def test_perfect_poses_score_1(demo: DemoSet) -> None:
    scores = scored(demo, demo.rows(perfect))
    assert scores.recalls.ar == 1.0
    assert numbers(scores) == (1.0, 1.0, 1.0)
    n = len(demo.asked)
    assert n >= 10
    assert (scores.counts.targets, scores.counts.scored, scores.counts.missing) == (n, n, 0)
    assert scores.counts.unasked == scores.counts.surplus == 0
    assert mean_errors(scores.answers) == pytest.approx((0, 0), abs=1e-5)
    assert correct_share(scores.answers) == 1.0
    assert scores.mean_time_s == 0.5


def test_poses_that_look_the_same_score_the_same(demo: DemoSet) -> None:
    rows = demo.rows(demo.symmetric)
    assert any(
        np.abs(row.T_cam_obj - T_of(truth)).max() > 0.1 for row, (_, _, truth) in zip(rows, demo.asked, strict=True)
    )
    scores = scored(demo, rows)
    assert numbers(scores)[1:] == (1.0, 1.0)
    # The meshes are not quite round, and steps of a continuous symmetry shift their facets.
    assert numbers(scores)[0] > 0.95
    turn_deg, shift_mm = mean_errors(scores.answers)
    assert turn_deg < 1e-4
    assert shift_mm < 1e-4


@settings(max_examples=12)
@given(st.integers(0, 10**6))
def test_any_file_scores_what_the_plain_computation_says(demo: DemoSet, seed: int) -> None:
    """Rows in any order: right and wrong ones of equal scores, missing ones, ids not asked for, rounded matrices."""
    rng = np.random.default_rng(seed)
    rows = [*demo.rows(disturbed), *demo.rows(perfect)]
    chosen = rng.permutation(len(rows))[: rng.integers(1, len(rows) + 1)]
    rows = [replace(rows[k], score=float(rng.integers(0, 3))) for k in chosen]
    strange = [replace(rows[0], score=9.0, **{name: 99}) for name in ("scene_id", "im_id", "obj_id")]
    given = table([*strange, *rows])
    given.R[:] = np.round(given.R, 1) if seed % 2 else given.R
    scores, asked = scored(demo, given), {row[:3] for row in given.ids[len(strange) :]}
    expected = reference.average_recalls(given, demo.truth, demo.targets)
    assert numbers(scores) == pytest.approx(expected, abs=1e-12)
    counts = scores.counts
    assert (counts.unasked, counts.scored, counts.surplus) == (3, len(asked), len(rows) - len(asked))
    assert counts.missing == sum(a.row is None for a in scores.answers) == len(demo.asked) - len(asked)


def test_a_pose_that_is_no_pose_is_not_found(demo: DemoSet) -> None:
    given = table(demo.rows(perfect))
    given.t_mm[0] = np.nan
    given.R[1] = np.inf
    given.t_mm[2] = 0.0
    given.t_mm[3] = 1e300
    share = 1 - 4 / len(demo.asked)
    scores = scored(demo, given)
    assert numbers(scores) == pytest.approx((share, share, share))
    assert scores.counts.missing == 0
    assert correct_share(scores.answers) == pytest.approx(share)


def test_methods_together_score_as_alone_with_any_number_of_threads(demo: DemoSet) -> None:
    tables = [table(demo.rows(perfect)), table(demo.rows(disturbed)), table(demo.rows(disturbed)[::2]), table([])]
    alone = [numbers(scored(demo, t)) for t in tables]
    assert alone[3] == (0, 0, 0)
    for workers in (1, 3):
        together = bop_scores(tables, demo.truth, demo.targets, workers=workers)
        assert [numbers(s) for s in together] == alone
        assert [s.answers for s in together][1] == scored(demo, tables[1]).answers


def test_objects_and_scenes_add_up(demo: DemoSet) -> None:
    scores = scored(demo, demo.rows(disturbed))
    assert scores.recalls is not None
    for parts in (scores.recalls_by_object, scores.recalls_by_scene):
        assert sum(r.n_targets for r in parts.values()) == len(demo.asked)
        for name in ("ar_vsd", "ar_mssd", "ar_mspd", "ar"):
            weighted = sum(r.n_targets * getattr(r, name) for r in parts.values()) / len(demo.asked)
            assert weighted == pytest.approx(getattr(scores.recalls, name))
    assert set(scores.recalls_by_scene) == {3, 4}


def test_problems_in_memory_score_as_their_folder(demo: DemoSet) -> None:
    truth = ProblemGroundTruth("demo", demo.problems)
    assert {k: dict(v) for k, v in truth.targets.counts.items()} == {k: dict(v) for k, v in demo.targets.counts.items()}
    # The writer's targets are made by the same rule.
    in_folder = visible_targets(demo.truth, demo.targets.counts)
    assert in_folder.counts == {image: dict(counts) for image, counts in demo.targets.counts.items()}
    given = table(demo.rows(disturbed))
    in_memory = bop_scores([given], truth, truth.targets)[0]
    # The folder's depth was rounded to 0.1 mm.
    assert numbers(in_memory) == pytest.approx(numbers(scored(demo, given)), abs=0.005)
    assert numbers(in_memory)[1:] == pytest.approx(numbers(scored(demo, given))[1:], abs=1e-12)


def test_localization_needs_to_know_how_many_there_are(demo: DemoSet) -> None:
    targets = Targets("test_targets_bop24.json", {(3, 0): {}}, "detection")
    with pytest.raises(SettingsError, match="bop19"):
        bop_scores([table([])], demo.truth, targets, "localization")


@settings(max_examples=15)
@given(st.integers(0, 10**6))
def test_a_rigid_motion_of_the_file_s_pose_never_beats_the_truth(demo: DemoSet, seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = transform(axis_angle(rng.normal(size=3), rng.uniform(0, 3)), rng.normal(size=3) * 0.02)
    scores = scored(demo, demo.rows(lambda k, truth: T_of(truth) @ T))
    assert 0 <= scores.recalls.ar <= 1
    for recalls in (scores.recalls.vsd, scores.recalls.mssd[None], scores.recalls.mspd[None]):
        assert (np.diff(recalls, axis=1) >= 0).all()  # a looser threshold finds no fewer
    assert (np.diff(scores.recalls.vsd, axis=0) >= 0).all()  # nor does a looser tolerance


def test_the_score_of_own_images_is_that_of_targets_without_the_others(demo: DemoSet) -> None:
    tables = [table(demo.rows(disturbed), "a"), table(demo.rows(perfect)[::2], "b")]
    some, none, few = list(demo.targets.counts)[1:3], None, list(demo.targets.counts)[:1]
    for task in ("localization", "detection"):
        found = bop_scores(tables, demo.truth, demo.targets, task, own_parts=[own(some), none])
        plain = bop_scores(tables, demo.truth, demo.targets, task)
        assert found[1].own is None
        assert [s.own for s in plain] == [None, None], task
        assert [every_number(s) for s in found] == [every_number(s) for s in plain], task
        first, second = (
            bop_scores(
                tables, demo.truth, replace(demo.targets, counts={i: demo.targets.counts[i] for i in images}), task
            )
            for images in (some, few)
        )
        assert found[0].own is not None
        assert every_number(found[0].own) == every_number(first[0]) != every_number(plain[0]), task
        both = bop_scores(tables, demo.truth, demo.targets, task, own_parts=[own(some), own(few)])
        assert [every_number(s.own) for s in both if s.own] == [every_number(first[0]), every_number(second[1])], task


def own(images: list[tuple[int, int]], objects: frozenset[int] | None = None) -> OwnPart:
    return OwnPart(frozenset(images), "run", objects)


def test_the_score_of_own_objects_is_that_of_targets_without_the_others(demo: DemoSet) -> None:
    tables = [table(demo.rows(disturbed), "a")]
    images = list(demo.targets.counts)[:3]
    some = frozenset(list(demo.targets.counts[images[0]])[:2])
    for task in ("localization", "detection"):
        (found,) = bop_scores(tables, demo.truth, demo.targets, task, own_parts=[own(images, some)])
        if task == "localization":
            counts = {i: {o: n for o, n in demo.targets.counts[i].items() if o in some} for i in images}
            (alone,) = bop_scores(tables, demo.truth, replace(demo.targets, counts=counts), task)
            assert every_number(found.own) == every_number(alone), task
        assert set(found.own.recalls_by_object) | set(found.own.precision_by_object) == some, task


def every_number(scores: BopScores) -> list[object]:
    """What can be compared by equality."""
    recalls = [scores.recalls, *scores.recalls_by_object.values(), *scores.recalls_by_scene.values()]
    arrays = [[r.n_targets, r.vsd.tolist(), r.mssd.tolist(), r.mspd.tolist()] for r in recalls if r is not None]
    precision = [scores.precision, *scores.precision_by_object.values()]
    return [arrays, precision, scores.answers, scores.counts.targets, scores.counts.scored, scores.counts.missing]
