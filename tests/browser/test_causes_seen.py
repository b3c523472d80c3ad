"""Failures whose cause a picture shows by itself: the answer upside down, what the image allows, each hypothesis."""

from __future__ import annotations

import numpy as np
import pytest

PICTURE = "document.querySelector('.stage canvas').toDataURL()"
WIDE = {"width": 1440, "height": 900}
SHADED = "(await import('/web/sides.js')).shadedOf(moment.obj, moment.a.T, `shaded a ${moment.obj}`) !== null"


def judged(screen):
    """Run to the end, past what stops it, until the verdict is there."""
    for _ in range(12):
        screen.key(" ")
        screen.until("state.running.branch == null && !state.busy.text && moment.run.rows.length > 0")
        if screen.state("moment.over"):
            break
    screen.until("moment.isAnswer && moment.verdict !== null")
    return screen


def test_an_answer_upside_down_is_shaded_as_it_is_with_its_axes_and_colours(show):
    screen = judged(show("failure_score_prefers_flip", size=WIDE))
    assert screen.state("[moment.a.name, moment.b.name]") == ["best", "ground truth"]
    tools = screen.page.locator(".pane.image .tools")
    tools.locator("select").first.select_option("shaded")
    assert tools.locator(".letter").inner_text() == "A"  # The answer, not the truth that it is compared with.
    # The axes are there unasked: the answer's z points the other way.
    axes = screen.state("(await import('/web/drawn_unasked.js')).axesOf(moment)")
    z = [np.array(T).reshape(4, 4)[:3, 2] for _, T in axes]
    assert z[0] @ z[1] == pytest.approx(-1, abs=0.01)
    screen.until(SHADED)
    drawn = screen.page.evaluate(PICTURE)
    chip = screen.page.locator(".stage .legend button", has_text="axes")
    chip.click()
    screen.until("state.view.axes === false")
    assert screen.page.evaluate(PICTURE) != drawn
    # The score has no colour here, and its maps are there all the same.
    assert screen.state("state.frame.colour_weight") == 0
    screen.until("(await import('/web/sides.js')).sidesOf(moment).a?.arrays?.correlation !== undefined")
    assert screen.page.locator(".map-name", has_text="adds to f_c").count() == 1
    screen.shot("flip")


@pytest.mark.parametrize(
    ("session", "layer"), [("failure_mask_leaks", "mask"), ("failure_wrong_plane", "support plane")]
)
def test_a_mask_or_plane_that_is_to_blame_is_drawn_unasked_until_it_is_hidden(show, session, layer):
    screen = judged(show(session, size=WIDE))
    chip = screen.page.locator(".stage .legend button", has_text=layer)
    assert "off" not in chip.get_attribute("class").split()
    drawn = screen.settled(PICTURE)
    chip.click()
    screen.until("state.view.layers.hidden.includes(arg)", layer.split()[-1])
    assert "off" in chip.get_attribute("class").split()
    assert screen.settled(PICTURE) != drawn
    screen.shot(f"blamed_{session}")


def test_a_starved_hypothesis_stands_first_without_a_call(show):
    screen = judged(show("failure_arm_starved", size=WIDE))
    run = screen.app.debugger.space.work.first.run
    plays = [sum(i.arm == j for i in run.iterations) for j in range(len(run.problem.instances[0].hypotheses))]
    calls = screen.page.locator(".calls")
    calls.wait_for()  # By itself: no tab was chosen.
    lanes = zip(calls.locator("button.number").all(), calls.locator("> b").all(), strict=True)
    shown = {int(number.inner_text().split()[0].removesuffix("✓")) - 1: int(n.inner_text()) for number, n in lanes}
    assert shown == dict(enumerate(plays))
    nearest = next(iter(shown))
    assert shown[nearest] == 0
    assert nearest == int(np.argmin(screen.state("moment.starts.map(s => s.err)")))
    assert calls.locator("svg").first.locator("path.good, path.bad").count() == 0
    screen.shot("starved")


def test_starts_beyond_the_range_of_the_refiner_lie_outside_its_band(show):
    screen = judged(show("failure_out_of_range", size=WIDE))
    starts = screen.page.locator(".starts svg")
    starts.wait_for()
    band = starts.locator("rect.right").bounding_box()
    for one in starts.locator("circle").all():
        box = one.bounding_box()
        middle = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
        assert middle[0] > band["x"] + band["width"] or middle[1] < band["y"]
    assert starts.locator("circle.bad").count() == len(screen.state("moment.starts"))
    screen.shot("out_of_range")


def test_what_the_image_allows_is_one_chip_in_the_photo_and_in_3d(show):
    screen = judged(show("failure_score_prefers_wrong", size=WIDE))
    screen.until("moment.verdict.allowed !== null")
    poses = screen.state("moment.verdict.allowed.poses")
    assert 0 < len(poses) <= 12
    asked = "(await import('/web/wants.js')).lookAt(state, moment).allowed.length"
    chip = screen.page.locator(".stage .legend button", has_text="allowed by the image")
    is_on = screen.state(asked) > 0
    assert (chip.get_attribute("class") == "off") is not is_on
    before = screen.settled(PICTURE)
    chip.click()
    screen.until(f"({asked}) === arg", 0 if is_on else len(poses))
    assert screen.settled(PICTURE) != before
    in_3d = screen.page.locator(".pane.scene .layers button", has_text="allowed by the image")
    in_3d.click()
    screen.until(f"({asked}) === arg", len(poses) if is_on else 0)
    screen.shot("allowed")


@pytest.mark.parametrize(
    ("session", "name", "other", "tab"),
    [
        ("failure_icp_slides", "added_by_refiner", "added_by_simulation", "errors"),
        ("failure_simulation_topples", "added_by_simulation", "added_by_refiner", "physics"),
    ],
)
def test_what_led_an_answer_away_is_drawn_and_the_film_leads_to_its_iteration(show, session, name, other, tab):
    screen = judged(show(session, size=WIDE))
    finding = screen.state("moment.verdict.findings[0]")
    diameter = screen.state("moment.object.diameter_mm")
    assert finding["numbers"][name] > 5 * finding["numbers"][other]
    away = screen.page.locator(".led-away")
    away.wait_for()  # By itself: no tab was chosen.
    shown = [float(b.split()[0].removeprefix("+")) for b in away.locator("> b").all_inner_texts()]
    keys = ("error_before", "added_by_simulation", "added_by_refiner", "error")
    assert shown == pytest.approx([diameter * finding["numbers"][key] for key in keys], abs=0.06)
    # Every hypothesis went away from the truth, and its way says so.
    assert screen.page.locator(".starts .way.bad").count() == len(screen.state("moment.starts"))
    screen.shot(f"led_away_{session}")
    screen.page.locator(".film .moment", has_text=f"Iteration {finding['k']}").last.click()
    screen.until("moment.k === arg && !moment.isAnswer", finding["k"])
    last = screen.state("moment.verdict.film.filter((one) => one.k === moment.k && one.stage).at(-1).stage")
    assert screen.state("state.view.stage") == last
    assert screen.page.locator(".tabs [aria-selected=true]").inner_text().lower() == tab
    screen.shot(f"to_cause_{session}")
