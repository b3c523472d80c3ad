"""The page in a browser: the first minute, every panel, keys, links, scrubbing, forking, moving a pose by hand."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from tests.browser.conftest import SESSIONS, SIZE, SLOW_MS, Look, Screen, until_true
from verefine_viz.core.geometry import apply
from verefine_viz.run.session_file import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.web.viser_internals import lost_words

MUG = SESSIONS / "mug.toml"


def test_first_minute_then_every_panel_and_a_branch(look: Look) -> None:
    screen = look(MUG, animate=True)
    screen.text("^5 hypotheses, best score")
    screen.shot("first_0_ready")
    screen.click("Step ▶")
    screen.text("^Iteration 1 · hypothesis . of 5")
    screen.at(1)
    screen.shot("first_1_stepped")
    screen.click("Run")
    assert screen.finished().startswith("score 0.9")
    screen.shot("first_2_run")
    assert screen.app.debugger.workspace.run.is_done
    panels(screen)
    timeline_and_links(screen)
    what_if(screen)


def panels(screen: Screen) -> None:
    for tab, words in (
        ("Score", "B − A"),
        ("Bandit", "^Answer: iteration .* took hypothesis"),
        ("Physics", "of the background lies on the support plane"),
        ("Errors", "^ground truth$"),
        ("Session", "not from a file|from .*mug.toml"),
    ):
        screen.tab(tab)
        screen.text(words)
        screen.shot(f"panel_{tab.lower()}")
    for tab in ("UCB", "Pulls", "Error"):
        screen.curve(tab)
        screen.shot(f"curves_{tab.lower()}")


def timeline_and_links(screen: Screen) -> None:
    screen.page.locator(".vz.line svg g[data-cmd] rect").nth(6).click(timeout=SLOW_MS)
    screen.at(7)
    screen.page.locator("[data-floating-window]:has(.line)").get_by_role("slider").first.press("ArrowRight")
    screen.app.wait_until_idle()
    screen.at(8)
    screen.tab("Bandit")
    screen.page.locator(".vz tr[data-cmd]", has_text="initial").first.click(timeout=SLOW_MS)
    screen.at(0)


def what_if(screen: Screen) -> None:
    screen.tab("Bandit")
    screen.page.locator(".vz a", has_text="c = 0.4").first.click(timeout=SLOW_MS)
    screen.text("exploration = 0.4, from iteration 0")
    screen.app.wait_until_idle(60)
    assert len(screen.app.debugger.workspace.work.branches) == 2
    screen.shot("what_if")


def test_two_browsers_show_the_same_run_without_a_gpu_at_the_resolution_of_the_screen(look: Look) -> None:
    """Chromium draws by software here; smooth edges would take half as long again, and viser would draw fewer pixels
    after a few slow pictures.
    """
    screen = look(MUG)
    smoothed = "() => window.__viserMutable.canvas.getContext('webgl2').getContextAttributes().antialias"
    assert screen.page.evaluate(smoothed) is False
    held = "() => window.__viserTestpoints?.devSettings?.get().fixedDpr === window.devicePixelRatio"
    share = "() => { const c = window.__viserMutable.canvas; return c.width / c.clientWidth / devicePixelRatio; }"
    # The page that the tests look at was asked for fewer pixels.
    with screen.page.context.browser.new_page(viewport=SIZE) as page:
        page.goto(screen.app.url)
        until_true(page, held)
        until_true(page, "window.__viserTestpoints.rendererInfo?.render?.frame >= 8")
        assert page.evaluate(share) == pytest.approx(1.0, abs=0.01)
        page.get_by_role("button", name="Step ▶", exact=True).click(timeout=SLOW_MS)
        page.get_by_text(re.compile("^Iteration 1 of ")).filter(visible=True).first.wait_for(timeout=SLOW_MS)
        screen.at(1)


def test_keys_and_palette(look: Look) -> None:
    screen = look(MUG)
    screen.key("n")
    screen.at(1)
    screen.key("n")
    screen.at(2)
    screen.key("b")
    screen.at(1)
    screen.key("Space")
    screen.finished()
    length = screen.app.debugger.workspace.run.length
    screen.key("Home")
    screen.at(0)
    run = screen.app.debugger.workspace.run
    screen.key("PageDown")
    screen.until(lambda: run.cursor > 0)
    first = run.cursor
    screen.key("PageDown")
    screen.until(lambda: run.cursor > first)
    screen.key("PageUp")
    screen.at(first)
    screen.key("End")
    screen.at(length)
    screen.key("g")
    screen.key("c")
    screen.until(lambda: screen.app.debugger.options.cloud == "residual")
    assert "ground truth" not in screen.app.debugger.options.layers
    screen.page.keyboard.press("Control+k")
    screen.page.get_by_placeholder("Search commands...").fill("first")
    screen.page.keyboard.press("Enter")
    screen.at(0)


def test_a_click_on_a_ghost_shows_its_history_and_on_the_cloud_and_on_a_map_it_probes(look: Look) -> None:
    screen = look(MUG)
    screen.app.send(c.ShowLayer("cloud", False))
    screen.app.wait_until_idle()
    screen.page.mouse.click(*on_screen(screen, arm=0))
    screen.until(lambda: screen.app.debugger.options.arm is not None)
    screen.app.send(c.ShowLayer("hypotheses", False))
    screen.app.send(c.ShowLayer("cloud", True))
    screen.app.wait_until_idle()
    screen.page.mouse.click(*on_screen(screen))
    screen.until(lambda: screen.app.debugger.options.pixel is not None)
    probed = screen.app.debugger.options.pixel
    assert probed is not None
    rows, columns = screen.app.debugger.workspace.work.problem.instances[0].mask.nonzero()
    assert columns.min() <= probed[0] <= columns.max()
    assert rows.min() <= probed[1] <= rows.max()
    screen.click("Step ▶")
    screen.at(1)
    screen.tab("Bandit")
    picture = screen.page.locator(".vz.strip img").nth(2)
    picture.wait_for(timeout=SLOW_MS)
    box = picture.bounding_box()
    assert box is not None
    picture.click(position={"x": box["width"] * 0.6, "y": box["height"] * 0.3})
    screen.until(lambda: screen.app.debugger.options.pixel != probed)
    pixel = screen.app.debugger.options.pixel
    assert pixel is not None
    screen.text(rf"^pixel {pixel[0]}, {pixel[1]}$")
    crop = screen.page.locator(".vz.strip img").nth(2).get_attribute("data-crop")
    u0, v0, width, height = map(int, crop.strip("[]").split(","))
    assert abs(pixel[0] - (u0 + width * 0.6)) <= width / 40 + 1
    assert abs(pixel[1] - (v0 + height * 0.3)) <= height / 40 + 1
    screen.shot("probe")


def at_rest(screen: Screen) -> bool:
    """Whether the edited pose stays where it is: the page sends the last steps of a drag after its end."""
    pose = screen.app.debugger.options.edited
    screen.page.wait_for_timeout(1500)
    return screen.app.debugger.options.edited == pose


def test_a_pose_is_dragged_and_continued_from(look: Look) -> None:
    screen = look(MUG)
    screen.tab("Physics")
    screen.click("Edit pose")
    screen.text("The edited pose .* scores")
    before = screen.app.debugger.options.edited
    assert before is not None
    screen.page.wait_for_timeout(1500)
    x, y = on_screen(screen, along=0)
    screen.page.mouse.move(x, y)
    screen.page.wait_for_timeout(300)
    screen.page.mouse.down()
    for k in range(1, 11):
        screen.page.mouse.move(x + 4 * k, y + 2 * k)
        screen.page.wait_for_timeout(60)
    screen.page.mouse.up()
    screen.until(lambda: at_rest(screen))
    screen.shot("gizmo")
    after = screen.app.debugger.options.edited
    assert after is not None
    assert after != before
    numbers = screen.app.page.layout.physics.numbers
    assert any(abs(x) > 0.5 for x in numbers.shift.value)
    field = screen.page.locator("xpath=//label[.='Moved mm']/ancestor::*[.//input][1]//input").last
    letter = "e => getComputedStyle(e.closest('.mantine-NumberInput-root'), '::before').content"
    assert field.evaluate(letter) == '"z"'
    field.fill("7", timeout=SLOW_MS)
    screen.until(lambda: numbers.shift.value[2] == 7.0)
    field.press("ArrowUp")
    for key in ("n", "b", "Space"):  # Of the page: they do nothing here.
        field.press(key)
    screen.until(lambda: numbers.shift.value[2] == 8.0)
    assert not screen.app.debugger.workspace.run.length
    after = screen.app.debugger.options.edited
    assert after is not None
    assert after[11] == pytest.approx(before[11] + 0.008, abs=1e-6)
    screen.click("Continue from here")
    screen.text("edited, from iteration 0")
    screen.shot("continued")
    assert screen.app.debugger.workspace.run.edits[0].T_cam_obj == pytest.approx(after)


def test_a_program_that_has_ended_is_reported_until_it_is_back(look: Look) -> None:
    screen = look(MUG)
    line = "getComputedStyle(document.body, '::after').content"
    assert screen.page.evaluate(line) == "none"
    port = screen.app.server.get_port()
    screen.app.stop()
    until_true(screen.page, f"{line} !== 'none'")
    assert screen.page.evaluate(line) == f'"{lost_words(port)}"'
    screen.app = App(load_session(MUG), MUG, port=port).start()
    until_true(screen.page, f"{line} === 'none'")
    screen.text("^5 hypotheses, best score")
    assert screen.page.evaluate(line) == "none"


def on_screen(screen: Screen, arm: int | None = None, along: int | None = None) -> tuple[float, float]:
    """Where something is on the page: the object's observed middle, an arm's middle, or an arrow of the gizmo."""
    view = screen.app.debugger.view()
    support = view.problem.observation.support
    assert support is not None
    if arm is not None:
        T = view.state.arms[arm].current.T_cam_obj
        point_cam = apply(T, view.target.model.points.mean(axis=0)[None])[0]
    elif along is not None:
        T = view.options.T_cam_obj_edited
        assert T is not None
        point_cam = T[:3, 3] + 0.9 * view.target.model.diameter_m * 0.75 * T[:3, along]
    else:
        point_cam = view.target.instance.points_cam.mean(axis=0)
    point = apply(support.T_world_cam, point_cam[None])[0]
    client = next(iter(screen.app.server.get_clients().values()))
    eye, ahead = client.camera.position, client.camera.look_at - client.camera.position
    forward = ahead / np.linalg.norm(ahead)
    right = np.cross(forward, client.camera.up_direction)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    x, y, z = (point - eye) @ right, (point - eye) @ down, (point - eye) @ forward
    canvas = screen.page.locator("canvas").first.bounding_box()
    focal = canvas["height"] / 2 / math.tan(client.camera.fov / 2)
    return canvas["x"] + canvas["width"] / 2 + focal * x / z, canvas["y"] + canvas["height"] / 2 + focal * y / z
