"""Settings of breakpoints; when each stops a run is in tests/run/test_every_event.py."""

from __future__ import annotations

import pytest
from msgspec import structs

from verefine_viz.core.algorithm_settings import MOST, BreakpointSettings
from verefine_viz.core.errors import SettingsError
from verefine_viz.run.breakpoints import UNITS, number_of, with_changes


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
    for where, value in (("", -1.0), ("waiting.", float("nan")), ("", "far")):
        with pytest.raises(SettingsError, match=f"give a number from 0 to {MOST[name]}"):
            with_changes(BreakpointSettings(), ((where + name, value),))


def test_what_is_no_breakpoint_or_neither_on_nor_off_is_refused() -> None:
    with pytest.raises(SettingsError, match="the breakpoint unstable cannot be 7: give on or off"):
        with_changes(BreakpointSettings(), (("unstable", 7),))
    with pytest.raises(SettingsError, match=r"unknown breakpoint 'jump'; did you mean 'jump_mm'[?] available: "):
        with_changes(BreakpointSettings(), (("jump", 1.0),))
    with pytest.raises(SettingsError, match=r"unknown breakpoint 'waiting.unstable'"):
        with_changes(BreakpointSettings(), (("waiting.unstable", 1.0),))


def test_every_threshold_has_a_unit() -> None:
    assert set(UNITS) == {name for name, value in structs.asdict(BreakpointSettings()).items() if value is None}
