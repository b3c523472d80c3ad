"""Frames of a folder that are labelled: models placed by a click and in a box, moved, decided about, undone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.browser.conftest import Pages, Screen
from tests.browser.test_layout import SIZES, faults
from tests.labels.labelled import bare_dataset, problems
from verefine_viz.core.problem import Problem
from verefine_viz.page.app import App
from verefine_viz.run.label_session import label_session
from verefine_viz.scenes.labels import LABELS, read_labels

FAR_M = 0.01
"""A label is further from the truth than this only where it was not made from it."""


@dataclass
class Desk:
    """A window on two frames of a can before a carton, and what is true of the first."""

    screen: Screen
    problem: Problem
    file: Path

    def place_of(self, u: float, v: float) -> tuple[float, float]:
        """Where a pixel is on the screen: the image is fitted into its pane."""
        box, camera = self.screen.page.locator(".stage canvas").bounding_box(), self.problem.observation.camera
        scale = min(box["width"] / camera.width, box["height"] / camera.height)
        left, top = (
            box["x"] + (box["width"] - scale * camera.width) / 2,
            box["y"] + (box["height"] - scale * camera.height) / 2,
        )
        return left + scale * (u + 0.5), top + scale * (v + 0.5)

    def pixels_of(self, obj_id: int) -> Any:
        """(n, 2) columns and rows of an object."""
        return np.argwhere(self.problem.target(self.instance_of(obj_id)).instance.mask)[:, ::-1]

    def instance_of(self, obj_id: int) -> int:
        return next(i.instance_id for i in self.problem.instances if i.obj_id == obj_id)

    def choose(self, obj_id: int) -> None:
        self.screen.key("l")
        self.screen.page.keyboard.type(str(obj_id))
        self.screen.key("Enter")
        self.screen.until("state.view.model === arg", obj_id)

    def labels(self) -> list[Any]:
        return self.screen.state("state.labels.labels.map(l => [l.obj_id, l.state])")

    def until_labels(self, n: int) -> None:
        self.screen.until("state.labels.labels.length === arg && moment && !state.busy.text", n)


@pytest.fixture
def desk(pages: Pages, tmp_path: Path) -> Iterator[Desk]:
    made = problems()
    folder = bare_dataset(tmp_path / "data", made)
    app = App(label_session(folder, None, None, {}), port=0, folder=tmp_path / "sessions").start()
    try:
        app.wait_until_ready(120)
        screen = pages.show(app)
        screen.until("state.labels !== null")
        yield Desk(screen, made[0], folder / LABELS)
    finally:
        app.stop()


def test_a_frame_is_labelled_with_three_actions_an_object(desk: Desk) -> None:
    screen = desk.screen
    assert screen.state("[state.view.preset, state.frame.objects.length, moment]") == ["label", 0, None]
    first, second = sorted(i.obj_id for i in desk.problem.instances)

    desk.choose(first)  # A model, a click, and its label is accepted.
    middle = np.median(desk.pixels_of(first), axis=0)
    screen.page.mouse.click(*desk.place_of(*middle))
    desk.until_labels(1)
    screen.key("a")
    screen.until("state.labels.labels[0].state === 'accepted'")
    screen.shot("labels_placed")

    desk.choose(second)  # A model, a box, and its label is accepted.
    low, high = desk.pixels_of(second).min(axis=0) - 4, desk.pixels_of(second).max(axis=0) + 4
    start, end = desk.place_of(*low), desk.place_of(*high)
    screen.drag(start, (end[0] - start[0], end[1] - start[1]))
    desk.until_labels(2)
    assert screen.state("state.view.obj") == screen.state("state.labels.labels[1].obj")
    assert screen.page.locator(".candidates button").count() == screen.state("state.labels.labels[1].candidates.length")
    for width, height in SIZES:
        screen.page.set_viewport_size({"width": width, "height": height})
        screen.page.wait_for_timeout(300)
        assert faults(screen) == {}, width
        screen.shot(f"labels_found_{width}")
    screen.key("a")
    screen.until("state.labels.labels[1].state === 'accepted'")

    lamps = screen.page.locator(".label-list .lamp")
    lights = screen.state("state.labels.labels.map(l => l.light)")
    assert [lamps.nth(i).get_attribute("class") for i in range(2)] == [f"lamp {light}" for light in lights]
    assert screen.page.locator(".frame-cell .made").inner_text().strip() == "2"
    written = read_labels(desk.file)[desk.problem.frame]
    for label in written:
        truth = desk.problem.target(desk.instance_of(label.obj_id)).instance.T_cam_obj_gt
        assert truth is not None
        assert label.light != "green" or np.linalg.norm(label.pose[:3, 3] - truth[:3, 3]) < FAR_M

    screen.key("Control+z")
    screen.until("state.labels.labels[1].state === 'proposed'")
    screen.key("Control+Shift+z")
    screen.until("state.labels.labels[1].state === 'accepted'")
    screen.key("n")
    screen.until("state.frame.frame === '3/1' && state.labels.frame === '3/1'")
    assert screen.state("[state.labels.labels.length, state.view.preset]") == [0, "label"]
    screen.click("Export…")
    screen.page.locator(".export input").first.focus()
    screen.key("Escape")
    screen.until("state.overlay === null && !document.querySelector('.export')")
    screen.key("?")
    shown = screen.page.locator(".keys kbd").all_inner_texts()
    assert sorted(set(shown)) == sorted(shown)  # No key stands for two things.
    screen.shot("labels_keys")
    screen.key("Escape")
    assert screen.errors == []


def test_a_label_is_moved_snapped_noted_and_removed(desk: Desk) -> None:
    screen = desk.screen
    obj_id = desk.problem.instances[0].obj_id
    desk.choose(obj_id)
    screen.key("Escape")
    screen.until("state.view.model === null")
    desk.choose(obj_id)
    middle = np.median(desk.pixels_of(obj_id), axis=0)
    screen.page.mouse.click(*desk.place_of(*middle))
    desk.until_labels(1)
    T = np.array(screen.state("state.labels.labels[0].T")).reshape(4, 4)
    screen.until(
        "(await import('/web/outlines.js')).outlineOf(state.labels.labels[0].obj, state.labels.labels[0].T) !== null"
    )
    stage = screen.page.locator(".stage canvas")
    before = stage.bounding_box()
    screen.drag(desk.place_of(*middle), (12, 0))  # Of the object itself: beside it a drag moves the photo.
    n = screen.state("state.view.edited.past.length")
    assert stage.bounding_box() == pytest.approx(before, abs=0.1)
    screen.key("ArrowRight")
    screen.key("Shift+ArrowRight")
    moved = np.array(screen.state("state.view.edited.T")).reshape(4, 4)
    assert moved[0, 3] > T[0, 3] + 0.0005
    assert np.degrees(np.arccos((np.trace(moved[:3, :3].T @ T[:3, :3]) - 1) / 2)) == pytest.approx(0.5, abs=0.01)
    assert screen.state("state.view.edited.past.length") == n + 2
    screen.key("Control+z")  # Of the edited pose, not of the labels.
    assert screen.state("[state.view.edited.past.length, state.labels.labels.length]") == [n + 1, 1]
    screen.shot("labels_moved")
    screen.key("Enter")
    screen.until("!state.view.edited && !state.busy.text")
    desk.until_labels(1)
    screen.key("u")
    screen.until("document.activeElement.classList.contains('note')")
    screen.until("state.labels.labels[0].state === 'uncertain' && !state.labels.frames['3/0'].undecided")
    obj = screen.state("state.view.obj")
    screen.key("Escape")
    screen.until("!document.querySelector('input.note')")
    screen.key("Escape")
    assert screen.state("[state.view.obj, state.labels.labels[0].state]") == [obj, "uncertain"]
    screen.key("u")
    screen.until("document.activeElement.classList.contains('note')")
    screen.page.keyboard.type("handle")
    screen.page.locator(".label-list h2").click()  # A note is written without Enter.
    screen.until("state.labels.labels[0].note === 'handle'")
    assert [(one.state, one.note) for one in read_labels(desk.file)[desk.problem.frame]] == [("uncertain", "handle")]
    screen.key("Delete")
    screen.until("state.labels.labels.length === 0 && !moment")
    screen.key("Control+z")
    desk.until_labels(1)
    assert screen.errors == []


def test_a_frame_without_labels_is_drawn_in_3d_after_another(desk: Desk) -> None:
    screen = desk.screen
    veil = screen.page.locator(".pane.scene .loading")
    veil.wait_for(state="detached", timeout=60_000)
    for frame in ("3/1", "3/0"):
        screen.key("]" if frame == "3/1" else "[")
        screen.until("state.frame.frame === arg", frame)
        nodes = "document.querySelector('.pane.scene iframe').contentWindow.__viserMutable.nodeRefFromName"
        screen.until(f"!!{nodes}[`/frame/${{state.frame.id}}`]")
        veil.wait_for(state="detached", timeout=60_000)
    assert screen.errors == []
