"""Surroundings of a real frame on the page: an unknown object is hatched in the photo, dropped, and restored."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.browser.conftest import SLOW_MS, Look, saved

pytestmark = pytest.mark.data


def test_an_unknown_object_is_hatched_and_dropped(look: Look, shared_data: Path, tmp_path: Path) -> None:
    session = saved(
        tmp_path,
        scene={"source": "bop", "dataset": str(shared_data / "lm"), "frames": ["6/0"]},
        hypotheses={"source": "perturb", "max_per_object": 2},
        method={"iterations": 1},
        physics={"support": "observed", "collider": "hull"},
    )
    screen = look(session)
    hatched = screen.page.locator(".vz.contours [data-unknown]")
    hatched.first.wait_for(state="attached", timeout=SLOW_MS)
    n = hatched.count()
    assert n >= 2
    screen.tab("Physics")
    screen.text(r"^unknown object 1, \d+ × \d+ × \d+ mm drop$")
    screen.picture("surroundings_0_unknown_objects")
    screen.page.get_by_text("drop", exact=True).first.click(timeout=SLOW_MS)
    screen.text("^unknown object 1, .* mm, dropped restore$")
    around = screen.app.debugger.workspace.work.problem.observation.support.surroundings  # type: ignore[union-attr]
    assert around is not None
    assert [u.is_dropped for u in around.unknown] == [True] + [False] * (n - 1)
    assert screen.app.debugger.workspace.session.physics.dropped == (("6/0", 1),)
    screen.picture("surroundings_1_dropped")
    screen.page.get_by_text("restore", exact=True).first.click(timeout=SLOW_MS)
    screen.text(r"^unknown object 1, \d+ × \d+ × \d+ mm drop$")
    screen.page.get_by_text("use the plane alone", exact=True).click(timeout=SLOW_MS)
    screen.text("^Supported by a plane alone: use what the depth image shows$")
    screen.until(lambda: hatched.count() == 0)
