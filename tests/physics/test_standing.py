"""When a simulated object counts as one that would tip: by hand, as a law, and against the full verdict."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.physics.bodies import ball, box, placed, ring, standing, table, tilt_deg
from verefine_viz.core.geometry import angle_between, axis_angle
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed
from verefine_viz.core.records import SimulatedPath
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.physics.stability import TOPPLED_DEG, is_inside
from verefine_viz.recording.verify import first_difference

BRICK = box(0.06, 0.04, 0.1)


@pytest.fixture(scope="module")
def simulator(cache: Path) -> BulletSimulator:
    return BulletSimulator(PhysicsSettings(), cache)


def leaning(deg: float, about: float = 0.0, thing: ObjectModel = BRICK) -> Placed:
    """Its lowest corner or edge on the plane, turned by ``deg`` about a level axis."""
    return standing(thing, axis_angle([np.cos(about), np.sin(about), 0], np.deg2rad(deg)))


def test_a_box_on_an_edge_would_tip(simulator: BulletSimulator) -> None:
    for deg, n_steps in itertools.product((15, 30, -20), (1, 3)):
        path = simulator.settle(leaning(deg), (), table(), n_steps)
        assert path.tipping is not None, (deg, n_steps)
        assert path.tipping.step == n_steps, deg
        # By hand: the edge is below, the centre of mass 50 mm above the middle of the base, 20 mm from the edge.
        end = np.deg2rad(tilt_deg(path.T_cam_obj))
        by_hand_m = abs(0.02 * np.cos(end) - 0.05 * np.sin(end))
        assert path.tipping.overhang_m == pytest.approx(by_hand_m, abs=1e-3), (deg, n_steps)


@pytest.mark.usefixtures("processes")
def test_what_stands_does_not_tip(simulator: BulletSimulator) -> None:
    for thing, n_steps in itertools.product((BRICK, ball(), ring()), (1, 3, 20, 60)):
        assert simulator.settle(standing(thing), (), table(), n_steps).tipping is None, (thing.name, n_steps)


def test_what_fell_over_says_so_although_it_lies_still(simulator: BulletSimulator) -> None:
    path = simulator.settle(leaning(35), (), table(), 60)
    assert path.tipping.step == 1
    assert tilt_deg(path.T_cam_obj) > 80


def test_free_fall_or_beginning_deep_in_the_plane_is_no_tipping(simulator: BulletSimulator) -> None:
    high = placed(BRICK, (0, 0, 0.5), axis_angle([1, 0, 0], 0.5))
    assert simulator.settle(high, (), table(), 3).tipping is None
    R = axis_angle([1, 0, 0], np.deg2rad(20))
    sunk = placed(BRICK, (0, 0, -float((BRICK.vertices @ R.T)[:, 2].min()) - 0.015), R)
    for n_steps in (1, 3, 20):
        assert simulator.settle(sunk, (), table(), n_steps).tipping is None, n_steps


def test_without_gravity_or_steps_nothing_tips(simulator: BulletSimulator, cache: Path) -> None:
    weightless = BulletSimulator(PhysicsSettings(gravity_m_s2=0.0), cache)
    assert weightless.settle(leaning(20), (), table(), 3).tipping is None
    assert simulator.settle(leaning(20), (), table(), 0).tipping is None


def test_on_top_of_a_neighbour_its_top_carries(simulator: BulletSimulator) -> None:
    for shift_m, tips in ((0.0, False), (0.02, False), (0.045, True)):
        below = standing(box(0.06, 0.06, 0.05), instance_id=3)
        on_top = placed(box(0.06, 0.06, 0.06), (shift_m, 0, 0.0801))
        path = simulator.settle(on_top, (below,), table(), 3)
        assert (path.tipping is not None) == tips, shift_m
        if path.tipping is not None:
            assert path.tipping.overhang_m == pytest.approx(shift_m - 0.03, abs=4e-3), shift_m


def test_the_law_of_leaning_boxes(simulator: BulletSimulator, cache: Path) -> None:
    @given(deg=st.floats(0, 80), about=st.floats(0, 2 * np.pi), n_steps=st.integers(1, 5))
    @settings(max_examples=60, deadline=None)
    def law(deg: float, about: float, n_steps: int) -> None:
        thing = leaning(deg, about)
        path = simulator.settle(thing, (), table(), n_steps)
        end = plausibility(Placed(0, BRICK, path.T_cam_obj), (), table(), PhysicsSettings(), cache)
        if abs(end.margin_mm) > 1 and end.is_stable is not None and not _has_turned(path):
            assert (path.tipping is not None) == (end.margin_mm < 0), end.sentence
            if path.tipping is not None:
                assert 1e3 * path.tipping.overhang_m == pytest.approx(-end.margin_mm, abs=0.5)
        # The same again, bit for bit, whatever was simulated in between.
        assert first_difference(simulator.settle(thing, (), table(), n_steps), path) is None

    law()


def _has_turned(path: SimulatedPath) -> bool:
    """Whether it may have fallen over, and be told of although it stands."""
    return np.rad2deg(angle_between(path.Ts_cam_obj[0, :3, :3], path.T_cam_obj[:3, :3])) > TOPPLED_DEG - 1e-6


@given(
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=8),
    st.floats(0.01, 1),
    st.floats(0, 2 * np.pi),
)
def test_inside_means_that_no_direction_has_all_points_on_one_side(
    points: list[tuple[float, float]], gap: float, angle: float
) -> None:
    x, y = np.cos(angle), np.sin(angle)
    on_one_side = [
        (px + max(0.0, gap - (px * x + py * y)) * x, py + max(0.0, gap - (px * x + py * y)) * y) for px, py in points
    ]
    assert not is_inside(on_one_side)
    around = [*on_one_side, (-x - y * 2, -y + x * 2), (-x + y * 2, -y - x * 2)]
    assert is_inside([*around, (x, y)])
