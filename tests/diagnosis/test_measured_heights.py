"""Ground truth is possible, also where depth measures heights short; poses that no object can have are named."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.impossible_poses import built_in_frames, heights_of, lifted, named, real_frames, table, truth_of
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem
from verefine_viz.diagnosis.measured_heights import Base, heights_in_common
from verefine_viz.diagnosis.plane_doubt import plane_doubt
from verefine_viz.physics.proximity import Surfaces


def bases(rise: float, heights_mm: tuple[float, ...], off_mm: tuple[float, ...] = ()) -> list[Base]:
    """Of objects that lean alike, with middles at this share of their height, and so much beside."""
    off = np.resize(off_mm or 0.0, len(heights_mm))
    return [Base((rise * h + d) * 1e-3, h * 1e-3, (-1.5, -2.0)) for h, d in zip(heights_mm, off, strict=True)]


def test_three_that_agree_show_the_ratio_and_the_lean_in_spite_of_others() -> None:
    found = heights_in_common([*bases(-0.06, (90, 140, 240), (1, -1)), *bases(-0.3, (80,)), *bases(0.05, (100,))])
    assert found is not None
    assert (found.objects, found.lean_deg) == (3, pytest.approx(2.5))
    assert found.ratio == pytest.approx(0.94, abs=0.005)
    assert found.explained_m(0.2) == pytest.approx(0.012, abs=0.001)
    long = heights_in_common(bases(0.06, (90, 140, 240)))
    assert long is not None
    assert long.explained_m(0.1) == pytest.approx(-0.006)


def test_what_does_not_agree_or_matter_shows_nothing() -> None:
    for title, some in {
        "two": bases(-0.06, (90, 240)),
        "scattered": bases(-0.06, (90, 140, 240), (9, -9, 0)),
        "short by 1 %": bases(-0.01, (90, 140, 240)),
        "as high as each other, so that the plane may be off": bases(-0.06, (100, 105, 110)),
        "on something": bases(0.4, (90, 140, 240)),
    }.items():
        assert heights_in_common(some) is None, title


def on_a_sure_plane(frames: Iterable[Problem]) -> Iterator[Problem]:
    """Frames whose support plane is not in doubt."""
    for problem in frames:
        support = problem.observation.support
        if support is not None and not plane_doubt(support):
            yield problem


@pytest.mark.usefixtures("processes")
def test_of_built_in_scenes_ground_truth_is_possible_and_no_other_pose() -> None:
    frames = list(on_a_sure_plane(built_in_frames()))
    rows = table(frames)
    at_truth = rows.pop("ground truth")
    assert len(at_truth) >= 35
    assert [label for label, is_named in at_truth if is_named] == []
    counts = {what: (len(some), sum(is_named for _, is_named in some)) for what, some in rows.items()}
    assert {what: n - n_named for what, (n, n_named) in counts.items()} == {
        "sunk": 0,
        "floating": 0,
        "in a neighbour": 0,
    }


@pytest.mark.usefixtures("long_run")
def test_of_real_frames_ground_truth_is_possible_and_no_other_pose(shared_data: Path) -> None:
    frames = [p for p in real_frames(shared_data) if p.observation.support]
    sure = table(on_a_sure_plane(frames))
    counts = {what: (len(some), sum(is_named for _, is_named in some)) for what, some in sure.items()}
    assert counts == {"ground truth": (28, 0), "sunk": (28, 28), "floating": (28, 28), "in a neighbour": (28, 28)}
    assert not any(named(p, truth_of(p), Surfaces()) for p in frames)
    heights = {p.frame: h for p in frames if (h := heights_of(p, truth_of(p)))}
    assert set(heights) == {"50/1", "900/2"}
    assert heights["900/2"].ratio == pytest.approx(0.953, abs=0.005)
    assert heights["900/2"].lean_deg == pytest.approx(2.9, abs=0.3)


@pytest.mark.usefixtures("long_run")
def test_depth_that_measures_heights_shorter_still_accuses_no_pose(shared_data: Path) -> None:
    (problem,) = (p for p in real_frames(shared_data) if p.frame == "900/2")
    support = problem.observation.support
    assert support is not None

    def sunk_by(share: float) -> list[Float | None]:
        heights = [np.ptp(t.model.vertices @ T[:3, :3].T @ support.T_world_cam[2, :3]) for t, T in truths]
        return [lifted(T, support, -1e3 * share * h) for (_, T), h in zip(truths, heights, strict=True)]

    truths = [(t, T) for t, T in zip(problem.targets, truth_of(problem), strict=True) if T is not None]
    deeper = sunk_by(0.05)
    heights = heights_of(problem, deeper)
    assert heights is not None
    assert heights.ratio == pytest.approx(0.90, abs=0.01)
    assert named(problem, deeper, Surfaces()) == {}
