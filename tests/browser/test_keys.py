"""Keys do what they say wherever a person clicked before."""

from __future__ import annotations

import pytest

from tests.browser.conftest import SESSIONS, Look

pytestmark = pytest.mark.browser


def test_space_runs_after_a_click_on_a_tab(look: Look) -> None:
    screen = look(SESSIONS / "mug.toml")
    screen.tab("Errors")
    screen.page.wait_for_function("document.activeElement === document.body")
    screen.key("Space")
    screen.until(lambda: screen.app.debugger.view(deep=False).progress.done > 0)


def test_the_tabulator_key_reaches_no_box_that_is_not_seen(look: Look) -> None:
    screen = look(SESSIONS / "mug.toml")
    reached = """() => [...document.querySelectorAll('label')].filter(l => l.textContent === 'page link')
        .map(l => l.closest('.mantine-Flex-root').querySelector('input'))
        .map(i => {i.focus(); return document.activeElement === i;})"""
    assert screen.page.evaluate(reached) == [False]
