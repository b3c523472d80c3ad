"""Two runs side by side on the page: choose B, scrub both, jump to where they part, on built-in and on real frames."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.browser.conftest import SESSIONS, SIZE, SLOW_MS, Look, Screen
from verefine_viz.viewer import commands as c

MUG = SESSIONS / "mug.toml"


def choose(screen: Screen, label: str, option: str) -> None:
    """An option of a dropdown."""
    screen.page.get_by_label(label, exact=True).first.click(timeout=SLOW_MS)
    screen.page.get_by_role("option", name=option, exact=True).click(timeout=SLOW_MS)
    screen.page.wait_for_timeout(200)


def sides(screen: Screen):  # type: ignore[no-untyped-def]
    found = screen.app.debugger.view().comparison
    assert found is not None
    return found


def test_rir_against_sir_on_the_mug(look: Look, chromium: object) -> None:
    screen = look(MUG)
    screen.tab("A/B")
    screen.text("^Choose what B is: ")
    screen.shot("compare_0_nothing")
    screen.click("Run")
    screen.app.wait_until_idle(240)
    screen.finished()
    choose(screen, "Method of B", "sir")
    screen.click("Run B with these")
    screen.text(r"^A \(rir\) and B \(sir\) part at once: in iteration 1 B works on hypothesis \d of mug instead of \d")
    screen.app.wait_until_idle(60)
    two_pages_and_both_sliders_show_the_same_moment(screen, chromium)
    assert [row[-1] for row in screen.table("A → B", "ADD(-S)")] == [o.winner for o in sides(screen).outcomes]
    assert sides(screen).outcomes[0].winner in ("A", "B")
    screen.shot("compare_1_mug")
    screen.key("f")
    screen.until(lambda: sides(screen).place == sides(screen).departures.deed.place)
    screen.shot("compare_2_mug_first_difference")
    screen.key("t")
    screen.until(lambda: sides(screen).shown == {"A"})
    screen.key("t")
    screen.key("x")
    screen.until(lambda: sides(screen).name_a == "sir")
    screen.shot("compare_3_mug_swapped")


def two_pages_and_both_sliders_show_the_same_moment(screen: Screen, chromium: object) -> None:
    screen.text(r"^moment 25 / 25")
    other = Screen(screen.app, chromium.new_page(viewport=SIZE))  # type: ignore[attr-defined]
    other.tab("A/B")
    screen.click("◀")
    screen.text(r"^moment 24 / 25")
    other.text(r"^moment 24 / 25")
    other.at(24)
    other.click("◀ Back")
    screen.text(r"^moment 23 / 25")
    other.page.close()


@pytest.mark.data
def test_real_frame(look: Look, real_session: Path) -> None:
    screen = look(real_session)
    screen.app.send(c.RunUntil("end"))
    screen.app.wait_until_idle(240)
    screen.tab("A/B")
    choose(screen, "Preset of B", "published")
    choose(screen, "Method of B", "vf_depth")
    screen.click("Run B with these")
    screen.text(r"^A \(rir, recommended\) and B \(vf_depth, published\) ")
    screen.app.wait_until_idle(240)
    screen.shot("compare_real")
    screen.key("f")
    screen.until(lambda: sides(screen).place == sides(screen).departures.deed.place)
    screen.shot("compare_real_first_difference")
