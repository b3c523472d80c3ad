"""The layout at all window sizes and in both themes; keys in titles; presets, full panes and splitters."""

from __future__ import annotations

import re

import pytest

SIZES = [(1280, 800), (1440, 900), (1920, 1080), (2560, 1440)]
CUT = """(() => {
  const bars = '.pane > header, .pane > header h2, .controls, .controls .group, .status, .verdict, .presets, .button,'
    + ' .tab, .posed, .map-name, .acts, .tab-content h3, .table th';
  const cut = [...document.querySelectorAll(bars)].filter(e => e.offsetParent && !e.closest('.measure, .two, .named'));
  return cut.filter(e => e.scrollWidth > e.clientWidth + 1)
    .map(e => `${e.className || e.tagName} ${e.innerText.slice(0, 40)}: ${e.scrollWidth} > ${e.clientWidth}`);
})()"""
OVERLAPS = """(() => {
  const bars = ['.page', '.verdict', '.pane > header', '.tools', '.controls', '.controls .group', '.status', '.tabs',
    '.acts', '.posed'];
  const out = [], aside = '.measure, .splitter, .toasts, .veil, .popup';
  for (const bar of document.querySelectorAll(bars.join())) {
    const boxes = [...bar.children].filter(e => e.checkVisibility({ visibilityProperty: true }) && !e.matches(aside))
      .map(e => [e, e.getBoundingClientRect()]).filter(([, r]) => r.width && r.height);
    boxes.forEach(([one, a], i) => boxes.slice(i + 1).forEach(([other, b]) => {
      const [x, y] = [Math.min(a.right, b.right) - Math.max(a.left, b.left), Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top)];
      if (x > 1 && y > 1) out.push(`${one.className} ${other.className} in ${bar.className}: ${x.toFixed()}, ${y.toFixed()}`);
    }));
  }
  return out;
})()"""
FILLED = """(() => {
  const parts = [...document.querySelectorAll('.page > .pane, .page > .timeline, .page > .inspector, .page > .verdict, .page > .status')];
  const area = parts.filter(e => getComputedStyle(e).visibility !== 'hidden').map(e => e.getBoundingClientRect())
    .reduce((sum, r) => sum + r.width * r.height, 0);
  return area / innerWidth / innerHeight;
})()"""
CHOICES = """(() => {
  const context = document.createElement('canvas').getContext('2d');
  return [...document.querySelectorAll('select')].filter(e => e.offsetParent && e.selectedOptions[0]).filter((e) => {
    const css = getComputedStyle(e);
    context.font = css.font;
    const room = e.clientWidth - parseFloat(css.paddingLeft) - parseFloat(css.paddingRight) - 14; // and its arrow
    return context.measureText(e.selectedOptions[0].text).width > room;
  }).map(e => `${e.title || e.className}: ${e.selectedOptions[0].text}`);
})()"""
SIDEWAYS = """[document.documentElement, ...document.querySelectorAll('.tab-content, .objects .scroll, .timeline, .inspector')]
  .filter(e => e.scrollWidth > e.clientWidth + 1).map(e => `${e.className}: ${e.scrollWidth} > ${e.clientWidth}`)"""
UNTITLED = "[...document.querySelectorAll('button')].filter(b => b.offsetParent && !b.title).map(b => b.outerHTML.slice(0, 120))"
TABS = "(await import('/web/tabs/all.js')).tabs.map(t => t.title.toLowerCase())"


def finished(show, size=SIZES[0], session="mug"):
    screen = show(session, size={"width": size[0], "height": size[1]})
    screen.key(" ")
    screen.until("moment.isAnswer")
    return screen


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("session", ["mug", "clutter"])
def test_nothing_is_cut_or_overlaps_or_scrolls_sideways(show, size, session):
    screen = finished(show, size, session)
    for theme in ("light", "dark"):
        if screen.state("state.theme") != theme:
            screen.key("t")
            screen.until("state.theme === arg", theme)
        faults = []
        for tab in screen.state(TABS) if theme == "dark" else ("score",):
            screen.tab(tab)
            codes = {"cut": CUT, "overlap": OVERLAPS, "scrolls": SIDEWAYS, "choice": CHOICES, "no title": UNTITLED}
            faults += [(tab, what, found) for what, code in codes.items() for found in screen.page.evaluate(code)]
            tops = screen.page.locator(".tabs > .tab").evaluate_all("all => all.map(e => e.offsetTop)")
            faults += [(tab, "tabs in rows", tops)] if len(set(tops)) > 1 else []
        assert faults == [], "\n".join(str(fault) for fault in faults)
        screen.tab("score")
        screen.page.wait_for_timeout(300)
        screen.shot(f"layout_{session}_{size[0]}_{theme}")


@pytest.mark.parametrize("size", [SIZES[0], SIZES[2]])
def test_presets_fill_the_window_and_so_does_a_pane(show, size):
    screen = finished(show, size)
    for preset in ("Maps", "Compare", "Gallery", "Inspect"):
        screen.click(preset)
        screen.until("state.view.preset === arg", preset.lower())
        screen.page.wait_for_timeout(300)
        assert screen.page.evaluate(FILLED) > 0.97, preset
        assert screen.page.evaluate(OVERLAPS) == []
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
    screen = finished(show)
    titles = screen.page.locator("button[title], header[title]").evaluate_all("all => all.map(b => b.title)")
    keys = {key for title in titles for key in re.findall(r"\((?:hold )?([A-Z?0-9←→]|Space|Esc|Shift\+[A-Z]|Ctrl\+K)[,)]", title)}
    assert {"S", "→", "←", "Space", "G", "T"} <= keys
    screen.key("?")
    shown = set(screen.page.locator(".keys kbd").all_inner_texts())
    assert {key for key in keys if not key.isdigit()} <= shown
    screen.shot("help")
    screen.key("Escape")
    screen.until("state.overlay === null")


def test_splitters_are_dragged_and_remembered(show):
    screen = finished(show)
    before = screen.page.locator(".pane.image").bounding_box()
    for area, (dx, dy) in {"split-image": (90, 0), "split-maps": (0, -50), "split-inspector": (-60, 0)}.items():
        bar = screen.page.locator(f".splitter.{area}").bounding_box()
        x, y = bar["x"] + bar["width"] / 2, bar["y"] + bar["height"] / 2
        screen.page.mouse.move(x, y)
        screen.page.mouse.down()
        screen.page.mouse.move(x + dx, y + dy, steps=5)
        screen.page.mouse.up()
        screen.page.wait_for_timeout(200)
        after = screen.page.locator(f".splitter.{area}").bounding_box()
        assert (after["x"] - bar["x"], after["y"] - bar["y"]) == pytest.approx((dx, dy), abs=4)
    dragged = screen.page.locator(".pane.image").bounding_box()
    assert dragged["width"] != before["width"]
    screen.page.reload()
    screen.until("state.frame !== null")
    screen.page.wait_for_timeout(300)
    assert screen.page.locator(".pane.image").bounding_box() == pytest.approx(dragged, abs=2)
