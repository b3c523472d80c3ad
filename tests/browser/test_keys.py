"""Keys do what they say wherever a person clicked before."""

from __future__ import annotations

import numpy as np
import pytest

from tests.browser.conftest import SESSIONS, Look, Screen, until_true
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import RequestQueue
from verefine_viz.viewer.panels.page_layout import KEYS


def test_a_refused_number_a_tap_of_the_camera_and_keys_after_a_click_on_a_tab(look: Look) -> None:
    screen = look(SESSIONS / "mug.toml")
    a_tap_moves_the_camera_a_little_and_v_takes_it_back(screen)
    a_number_that_cannot_be_used_stays_in_its_box_and_is_refused(screen)
    the_tabulator_key_reaches_no_hidden_box_and_space_runs_after_a_click_on_a_tab(screen)


def a_tap_moves_the_camera_a_little_and_v_takes_it_back(screen: Screen) -> None:
    at = "() => window.__viserMutable.cameraControl.getPosition().toArray()"
    first = np.array(screen.page.evaluate(at))
    distance = screen.page.evaluate("() => window.__viserMutable.cameraControl.distance")
    screen.page.wait_for_timeout(1500)  # No picture is drawn meanwhile: the library would make up for that time.
    screen.key("a")
    screen.page.wait_for_timeout(500)
    moved = np.linalg.norm(np.array(screen.page.evaluate(at)) - first)
    assert 0.01 * distance < moved < 0.1 * distance
    screen.key("Control+d")
    assert np.linalg.norm(np.array(screen.page.evaluate(at)) - first) == pytest.approx(moved)
    screen.key("ArrowUp")
    screen.key("v")
    until_true(screen.page, f"first => ({at})().every((x, k) => Math.abs(x - first[k]) < 1e-3)", list(first))


def a_number_that_cannot_be_used_stays_in_its_box_and_is_refused(screen: Screen) -> None:
    screen.page.get_by_role("tab", name="Settings", exact=True).click()
    box = screen.page.get_by_label("K", exact=True)
    box.fill("-3")
    box.blur()
    screen.text(r"^K = -3: input should be greater than or equal to 1\.")
    screen.click("Restart with these")
    screen.text(r"method\.iterations = -3")
    assert box.input_value() == "-3"
    screen.shot("settings_refused")
    box.fill("2")
    box.blur()
    screen.page.wait_for_timeout(200)
    screen.click("Restart with these")
    screen.until(lambda: screen.app.debugger.workspace.session.method.iterations == 2)
    screen.text("^Iteration 0 of 10")


def the_tabulator_key_reaches_no_hidden_box_and_space_runs_after_a_click_on_a_tab(screen: Screen) -> None:
    reached = """() => [...document.querySelectorAll('label')].filter(l => l.textContent === 'page link')
        .map(l => l.closest('.mantine-Flex-root').querySelector('input'))
        .map(i => {i.focus(); return document.activeElement === i;})"""
    assert screen.page.evaluate(reached) == [False]
    screen.tab("Errors")
    until_true(screen.page, "document.activeElement === document.body")
    screen.key("Space")
    screen.until(lambda: screen.app.debugger.view(deep=False).progress.done > 0)


NAMES = {"pageup": "PageUp", "pagedown": "PageDown"}
"""What the browser calls a key, where that is not the name with a capital, or a letter."""


def test_every_key_sends_its_command(look: Look, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[c.Command] = []
    send = RequestQueue.send

    def noted(queue: RequestQueue, command: c.Command) -> None:
        sent.append(command)
        send(queue, command)

    monkeypatch.setattr(RequestQueue, "send", noted)
    screen = look(SESSIONS / "mug.toml")
    screen.app.send(c.RunUntil("end"))
    screen.app.wait_until_idle(240)
    for _, key, command in KEYS:
        if key is not None:
            sent.clear()
            screen.key(key.lower() if len(key) == 1 else NAMES.get(key, key.capitalize()))
            screen.until(lambda command=command: command in sent)
