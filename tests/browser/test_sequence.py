"""The timeline of a sequence: keys zoom it, a drag sums a span up, a click opens the frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.planted_sequence import HALF_TURN
from tests.scenes.test_trace import SHAPE, K, picture, pose, write_box
from verefine_viz.page.app import App
from verefine_viz.run.data_folder import open_session
from verefine_viz.trace import Trace

N, FLIP, LOST, FOUND = 24, 8, 14, 17
SPAN = "[state.sequence.from, Math.min(state.sequence.to, 24)]"


@pytest.fixture
def app(tmp_path: Path):
    """Two boxes in 24 traces without ground truth; the second flips in frame 8 and is lost in frames 14 to 16."""
    mesh = write_box(tmp_path / "box.obj")
    depth, mask = picture()
    for i in range(N):
        with Trace(tmp_path / "traces" / f"{i}", K=K, depth_m=depth, rgb=np.full((*SHAPE, 3), 90, np.uint8)) as trace:
            for k, name in enumerate(("still box", "odd box")):
                T = pose(x=0.002 * i) @ (HALF_TURN[0] if k and i >= FLIP else np.eye(4))
                one = trace.object(name, mesh=mesh, mask=mask, unit_m=0.001)
                if not k or not LOST <= i < FOUND:
                    one.hypothesis(0, T, score=0.5)
                    one.answer(T, score=0.9 if i < 12 else 0.3)
    app = App(open_session(tmp_path / "traces", {}), port=0, folder=tmp_path / "sessions").start()
    app.wait_until_ready(120)
    yield app
    app.stop()


def test_keys_zoom_a_drag_sums_up_and_a_click_opens_the_frame_at_the_object(pages, app) -> None:
    screen = pages.show(app)
    before = screen.state("[state.theme, state.view.stage]")
    screen.key("g")
    screen.click("Timeline")
    lanes = screen.page.locator(".sequence-lanes")
    lanes.wait_for()
    box = lanes.bounding_box()

    def place(frame: float, lane: float) -> tuple[float, float]:
        """Where that is on the screen while all frames are in sight."""
        rem = screen.state("parseFloat(getComputedStyle(document.documentElement).fontSize)")
        left = round(min(9 * rem, 0.3 * box["width"]))
        width = box["width"] - left - 0.5 * rem
        return box["x"] + left + (frame + 0.5) / N * width, box["y"] + (1.7 + 1.9 * (lane + 0.5)) * rem

    marks = screen.page.locator(".sequence-marks li")
    assert [words.split() for words in marks.all_inner_texts()] == [
        ["0/8", "flip", "odd", "box"], ["0/14", "lost", "odd", "box"], ["0/17", "recovered", "odd", "box"],
    ]  # fmt: skip

    screen.page.mouse.move(*place(11, 0))
    for key in "wwd":
        screen.key(key)
    screen.until(f"{SPAN}[1] - {SPAN}[0] < 16")
    first, last = screen.state(SPAN)
    assert first < 11 < last
    for key in "sssss":
        screen.key(key)
    screen.until("state.sequence.to === Infinity")
    assert screen.state("[state.theme, state.view.stage]") == before, "D and S are keys of the page, too"

    start, end = place(12, 1), place(19, 1)
    screen.drag(start, (end[0] - start[0], 0))
    screen.until("state.sequence.brush?.join() === '12,19'")
    odd = screen.page.locator(".sequence-span tbody tr").nth(1).inner_text().split()
    # Frames with a pose, mean score, lost, recovered; without truth there is no column of errors.
    assert odd == ["odd", "box", "5", "of", "8", "0.30", "1", "1"]
    assert len(marks.all_inner_texts()) == 2
    screen.shot("sequence")
    screen.key("Escape")
    screen.until("state.sequence.brush === null")

    screen.page.mouse.click(*place(20, 1))
    screen.until("state.frame.frame === '0/20' && moment.object.label.startsWith('odd')")
    assert screen.state("state.view.preset") == "inspect"
    assert screen.errors == []
