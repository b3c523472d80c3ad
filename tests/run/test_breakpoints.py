"""Settings of breakpoints; when each stops a run is in tests/run/test_every_event.py."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs

from tests.changing import replace
from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.algorithm_settings import MOST, BreakpointSettings, ThresholdSettings
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.geometry import transform
from verefine_viz.core.settings import MethodSettings
from verefine_viz.methods.registry import make_method
from verefine_viz.run.breakpoints import LABELS, UNITS, hits, number_of, with_changes
from verefine_viz.run.engine import Run


def test_a_value_just_above_its_threshold_does_not_read_as_the_threshold() -> None:
    problem = box_problem(2)
    method = make_method(MethodSettings(name="sir"), FakeSimulator(), FakeRefiner(), FakeVerifier(), 3)
    record = Run(method, problem).step()
    jumped = record.stages[0].T_cam_obj @ transform(np.eye(3), [0, 0, 0.03004])
    stages = tuple(replace(s, T_cam_obj=jumped) if s is record.accepted_stage else s for s in record.stages)
    (reason,) = hits(BreakpointSettings(jump_mm=30.0), problem, replace(record, stages=stages))
    assert reason == "the pose jumped by 30.04 mm, more than 30 mm"


def test_some_are_changed_and_the_others_stay() -> None:
    set_before = BreakpointSettings(jump_mm=25.0, unstable=True)
    changed = with_changes(set_before, (("score_falls_by", 0.5), ("jump_mm", None)))
    assert changed == BreakpointSettings(score_falls_by=0.5, unstable=True, waiting=ThresholdSettings(jump_mm=25.0))


def test_the_number_of_a_breakpoint_that_is_off_waits() -> None:
    off = with_changes(BreakpointSettings(jump_mm=25.0), (("jump_mm", None), ("waiting.jump_deg", 4.0)))
    assert (off.jump_mm, off.jump_deg) == (None, None)
    assert [number_of(off, name) for name in UNITS] == [None, 25.0, 4.0, None]
    assert with_changes(off, (("jump_mm", None),)) == off
    on = with_changes(off, (("jump_mm", 7.0),))
    assert (on.jump_mm, on.waiting.jump_mm, number_of(on, "jump_mm")) == (7.0, None, 7.0)
    assert with_changes(off, (("waiting.jump_mm", 3.0),)).waiting.jump_mm == 3.0


@pytest.mark.parametrize("name", UNITS)
def test_no_threshold_is_refused_in_one_line(name: str) -> None:
    for where, value in (("", -1.0), ("waiting.", float("nan")), ("", float("inf")), ("", 99999999.0), ("", "far")):
        given = f"{value:.10g}{UNITS[name]}" if isinstance(value, float) else value
        bounds = f"give a number from 0 to {MOST[name]}{UNITS[name]}; it stays as it was"
        with pytest.raises(SettingsError) as refused:
            with_changes(BreakpointSettings(), ((where + name, value),))
        assert str(refused.value) == f"“{LABELS[name]}” cannot be {given}: {bounds}"


def test_what_is_no_breakpoint_or_neither_on_nor_off_is_refused() -> None:
    with pytest.raises(SettingsError, match="the breakpoint unstable cannot be 7: give on or off"):
        with_changes(BreakpointSettings(), (("unstable", 7),))
    with pytest.raises(SettingsError, match=r"unknown breakpoint 'jump'; did you mean 'jump_mm'[?] available: "):
        with_changes(BreakpointSettings(), (("jump", 1.0),))
    with pytest.raises(SettingsError, match=r"unknown breakpoint 'waiting.unstable'"):
        with_changes(BreakpointSettings(), (("waiting.unstable", 1.0),))


def test_every_threshold_has_a_unit() -> None:
    assert set(UNITS) == {name for name, value in structs.asdict(BreakpointSettings()).items() if value is None}
