"""The layout at all window sizes and in both themes; keys in titles; presets, full panes and splitters."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path

import pytest

HALF_A_SCREEN = (960, 1000)
SIZES = [(1280, 800), (1440, 900), (1920, 1080), (2560, 1440)]
FAULTS = (Path(__file__).parent / "layout_faults.js").read_text()
TABS = "(await import('/web/tabs/all.js')).tabs.map(t => t.title.toLowerCase())"


def faults(screen):
    return {kind: found for kind, found in screen.page.evaluate(FAULTS).items() if found}


@pytest.mark.parametrize("session", ["mug", "clutter"])
def test_nothing_is_cut_or_overlaps_or_scrolls_sideways(show, session):
    screen = show(session).finish()
    for (width, height), theme in product([HALF_A_SCREEN, *SIZES], ("light", "dark")):
        screen.page.set_viewport_size({"width": width, "height": height})
        screen.page.wait_for_timeout(300)
        if screen.state("state.theme") != theme:
            screen.key("d")
            screen.until("state.theme === arg", theme)
        # In half a screen tables of other tabs scroll.
        for tab in screen.state(TABS) if theme == "dark" and (width, height) in SIZES else ("score",):
            screen.tab(tab)
            assert faults(screen) == {}, (width, tab)
        screen.tab("score")
        screen.page.wait_for_timeout(300)
        screen.shot(f"layout_{session}_{width}_{theme}")


@pytest.mark.parametrize("size", [SIZES[0], SIZES[2]])
def test_presets_fill_the_window_and_so_does_a_pane(show, size):
    screen = show().finish()
    screen.page.set_viewport_size({"width": size[0], "height": size[1]})
    for preset in ("Maps", "Compare", "Gallery", "Inspect"):
        screen.click(preset)
        screen.until("state.view.preset === arg", preset.lower())
        screen.page.wait_for_timeout(300)
        assert faults(screen) == {}, preset
        screen.shot(f"preset_{preset.lower()}_{size[0]}")
    for pane in ("image", "maps", "scene"):
        title = screen.page.locator(f".pane.{pane} > header h2")
        title.dblclick()
        screen.until("state.view.full === arg", pane)
        screen.page.wait_for_timeout(300)
        box = screen.page.locator(f".pane.{pane}").bounding_box()
        assert box["width"] > 0.6 * size[0]
        assert box["height"] > 0.55 * size[1]
        screen.shot(f"full_{pane}_{size[0]}")
        title.dblclick()
        screen.until("state.view.full === null")


def test_keys_in_titles_are_in_the_help(show):
    screen = show().finish()
    titles = screen.page.locator("button[title], header[title]").evaluate_all("all => all.map(b => b.title)")
    keys = {
        key
        for title in titles
        for key in re.findall(r"\((?:hold )?([A-Z?0-9←→]|Space|Esc|Shift\+[A-Z]|Ctrl\+K)[,)]", title)
    }
    assert {"S", "→", "←", "Space", "G", "D"} <= keys
    screen.key("?")
    screen.until("state.overlay === 'help'")
    shown = set(screen.page.locator(".keys kbd").all_inner_texts())
    assert {one for one in keys if not one.isdigit()} <= shown
    screen.shot("help")
    screen.key("Escape")
    screen.until("state.overlay === null")
    screen.page.get_by_title("Evidence and what to do about it").click()
    assert faults(screen) == {}


def test_splitters_are_dragged_and_remembered(show):
    screen = show().finish()
    before = screen.page.locator(".pane.image").bounding_box()
    for area, (dx, dy) in {"split-image": (90, 0), "split-maps": (0, -50), "split-inspector": (-60, 0)}.items():
        bar = screen.page.locator(f".splitter.{area}").bounding_box()
        screen.drag((bar["x"] + bar["width"] / 2, bar["y"] + bar["height"] / 2), (dx, dy))
        screen.page.wait_for_timeout(200)
        after = screen.page.locator(f".splitter.{area}").bounding_box()
        assert (after["x"] - bar["x"], after["y"] - bar["y"]) == pytest.approx((dx, dy), abs=4)
    dragged = screen.page.locator(".pane.image").bounding_box()
    assert dragged["width"] != before["width"]
    screen.page.reload()
    screen.until("state.frame !== null")
    screen.page.wait_for_timeout(300)
    assert screen.page.locator(".pane.image").bounding_box() == pytest.approx(dragged, abs=2)
