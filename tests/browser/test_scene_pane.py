"""The 3D pane: its layers, the support plane in both pictures, and what is measured in them."""

from __future__ import annotations

import numpy as np
import pytest

from verefine_viz.page import protocol as p
from verefine_viz.pictures.surface_distances import signed_distances

SHOWN = "document.querySelector('.pane.scene .loading') === null && moment !== null"
NODES = """(() => {
  const nodes = document.querySelector('.pane.scene iframe').contentWindow.__viserMutable.nodeRefFromName;
  return Object.keys(nodes).filter((name) => nodes[name]);
})()"""


def node(screen, name):
    return screen.app.viser.scene._handle_from_node_name[name]


def seen_from_sensor(screen):
    """Take the 3D view to where the sensor was; return where in the window a pixel of the photo is seen."""
    screen.until(SHOWN)
    screen.click("Sensor")
    screen.app.wait_until_idle()
    screen.page.wait_for_timeout(1500)
    box = screen.page.locator(".pane.scene iframe").bounding_box()
    camera = screen.app.debugger.space.problem.observation.camera
    scale = box["height"] / camera.height

    def place(pixel):
        u, v = pixel
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        return x + scale * (u - camera.cx), y + scale * (v - camera.cy)

    return place


def test_clicks_in_3d_give_a_point_with_its_residual_and_a_distance(show):
    screen = show("mug").finish()
    problem = screen.app.debugger.space.problem
    observation, obj = problem.observation, problem.instances[0].instance_id
    place = seen_from_sensor(screen)
    screen.click("Measure")
    rows, columns = np.nonzero(problem.instances[0].mask & (observation.depth_m > 0))
    inside = [(int(columns[i]), int(rows[i])) for i in (len(rows) // 3, 3 * len(rows) // 4)]
    points = observation.camera.back_project(observation.depth_m)
    clicked = []
    for count, pixel in enumerate(inside):
        screen.page.mouse.click(*place(pixel))
        screen.until(["state.view.pixel !== null", "state.view.ruler !== null"][count])
        clicked.append(screen.state("state.view.ruler?.[1] ?? state.view.pixel"))
        assert np.abs(np.subtract(clicked[-1], pixel)).max() <= 4
        if count == 0:
            words = screen.text("point").inner_text()
            (u, v), T = clicked[0], np.reshape(screen.state("moment.best.T"), (4, 4))
            numbers = [float(x) for x in words.replace("−", "-").removeprefix("point").removesuffix("mm").split(",")]
            np.testing.assert_allclose(numbers, 1000 * points[v, u], atol=0.051)
            residual_m = signed_distances(points[v, u][None], [(problem.target(obj), T)], 0.1)[0]
            side = "inside" if residual_m < 0 else "outside"
            screen.text(f"{side} mug").get_by_text(f"{abs(1000 * residual_m):.1f} mm").wait_for()
            drawn = node(screen, "/cam/marked")
            assert drawn.visible
            np.testing.assert_allclose(drawn.points[0], [np.zeros(3), points[v, u]], atol=1e-6)  # Its ray.
    ends = [points[v, u] for u, v in clicked]
    screen.text(f"{1000 * np.linalg.norm(ends[0] - ends[1]):.1f} mm, depth")
    assert node(screen, "/cam/distance").text == f"{1000 * np.linalg.norm(ends[0] - ends[1]):.1f} mm"
    screen.shot("measured_3d")
    screen.view(pixel=inside[1], ruler=None)  # A pixel of the photo is seen in 3D as well.
    u, v = inside[1]
    screen.wait(lambda: np.allclose(node(screen, "/cam/marked").points[0, 1], points[v, u], atol=1e-6))
    assert screen.errors == []


def test_the_support_plane_is_outlined_in_3d_and_its_pixels_tinted_in_the_photo(show):
    screen = show("clutter")
    observation = screen.app.debugger.space.problem.observation
    T, normal = observation.support.T_world_cam, observation.support.normal_world
    points = observation.camera.back_project(observation.depth_m)
    heights_m = (points @ T[:3, :3].T + T[:3, 3]) @ normal
    on_plane = (np.abs(heights_m) < 0.01) & (observation.depth_m > 0) & ~observation.object_mask
    screen.view(zoom="image")
    read = """(() => {
      const canvas = document.querySelector('.pane.image canvas');
      return [...canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data];
    })()"""

    def picture():
        pixels = np.array(screen.settled(read), np.int16)
        width = screen.state("document.querySelector('.pane.image canvas').width")
        return pixels.reshape(-1, width, 4)[..., :3]

    screen.until("(await import('/web/sides.js')).photo()?.complete ?? true")
    before = picture()
    chip = screen.page.locator(".pane.image .legend").get_by_text("support plane")
    chip.click()
    screen.until("(await import('/web/store.js')).blob(state.frame.support.inliers) !== null")
    tinted = np.abs(picture() - before).max(axis=2) > 8
    height, width = tinted.shape
    scale = min(width / on_plane.shape[1], height / on_plane.shape[0])
    rows = np.clip(((np.arange(height) + 0.5 - height / 2) / scale + on_plane.shape[0] / 2).astype(int), -1, 10**6)
    columns = ((np.arange(width) + 0.5 - width / 2) / scale + on_plane.shape[1] / 2).astype(int)
    inside = np.ix_((rows >= 2) & (rows < on_plane.shape[0] - 2), (columns >= 2) & (columns < on_plane.shape[1] - 2))
    expected = on_plane[rows.clip(0, on_plane.shape[0] - 1)][:, columns.clip(0, on_plane.shape[1] - 1)]
    assert expected[inside].mean() > 0.5
    assert (tinted == expected)[inside].mean() > 0.95
    assert tinted[inside][~expected[inside]].mean() < 0.1
    screen.until(SHOWN)
    corners = node(screen, "/cam/plane_outline").points.reshape(-1, 3)
    np.testing.assert_allclose((corners @ T[:3, :3].T + T[:3, 3]) @ normal, 0, atol=1e-4)
    uv = observation.camera.project(corners.astype(float))[::2].ravel()
    np.testing.assert_allclose(screen.state("state.frame.support.outline"), uv, atol=0.2)
    assert node(screen, "/cam/plane_outline").visible
    screen.shot("support_plane")
    screen.page.locator(".pane.scene .layers").get_by_text("support plane").click()
    screen.wait(lambda: not node(screen, "/cam/plane_outline").visible)
    assert screen.errors == []


def test_a_veil_lies_over_3d_until_it_shows_the_frame_of_the_page(show):
    screen = show("mug")
    screen.until(SHOWN)
    first = screen.state("state.frame.id")
    assert f"/frame/{first}" in screen.state(NODES)
    frame = screen.page.frame_locator(".pane.scene iframe")
    assert frame.locator("[data-floating-window]").filter(visible=True).count() == 0  # viser's own panel
    screen.app.send(p.Open(demo="clutter"))
    screen.until("state.frame.id !== arg", first)
    assert screen.page.locator(".pane.scene .loading").count() == 1 or f"/frame/{first}" not in screen.state(NODES)
    screen.until(SHOWN)
    assert f"/frame/{screen.state('state.frame.id')}" in screen.state(NODES)
    assert screen.errors == []


def test_a_press_beside_a_handle_does_not_turn_the_view(show):
    screen = show("mug")
    screen.key("ArrowRight")
    screen.until("state.view.k === 1")
    screen.until(SHOWN)
    screen.key("p")
    screen.until("state.view.edited")
    inside = "document.querySelector('.pane.scene iframe').contentWindow"
    points = f"(await import('/web/gizmo_guard.js')).handlePoints({inside}, 170)"
    screen.until(f"{points}.length > 0")
    screen.page.wait_for_timeout(1500)
    where = f"{inside}.__viserMutable.camera.position.toArray()"
    box = screen.page.locator(".pane.scene iframe").bounding_box()
    handles = np.array(screen.state(points))
    size = np.array([box["width"], box["height"]])
    grid = np.stack(np.meshgrid(*[np.arange(70, n - 60, 2.0) for n in size]), axis=-1).reshape(-1, 2)
    far = np.linalg.norm(grid[:, None] - handles, axis=2).min(axis=1)
    for (x, y), turns in ((grid[np.abs(far - 21).argmin()], False), (grid[far.argmax()], True)):
        before = np.array(screen.state(where))
        screen.drag((box["x"] + x, box["y"] + y), (40, 15))
        if turns:
            screen.wait(lambda before=before: np.linalg.norm(screen.state(where) - before) > 1e-3)
        else:
            screen.page.wait_for_timeout(500)
            assert np.linalg.norm(screen.state(where) - before) <= 1e-3
    assert screen.errors == []


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_ground_of_3d_is_that_of_the_theme(show, theme):
    screen = show("mug")
    screen.state("(await import('/web/layout.js')).applyTheme()")
    if screen.state("state.theme") != theme:
        screen.key("d")
    screen.until(SHOWN)
    ground = screen.state("getComputedStyle(document.querySelector('.pane.scene .content')).backgroundColor")
    canvas = "document.querySelector('.pane.scene iframe').contentDocument.querySelector('canvas[data-engine]')"
    assert screen.state(f"getComputedStyle({canvas}).backgroundColor") == ground
