"""The picture of all score maps says what it is of, in letters that its typeface has."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import ImageDraw, ImageFont

from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.score_maps import maps_sheet
from verefine_viz.viewer.snapshot.snapshot import Snapshot

END = c.RunUntil("end")


def after(*commands: c.Command) -> Snapshot:
    return Debugger(Session(method=MethodSettings(iterations=2)), None, FakeTools).carry_out(commands).view()


def texts(view: Snapshot, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is written in the picture."""
    found: list[str] = []
    draw = ImageDraw.ImageDraw.text

    def write(self: ImageDraw.ImageDraw, at: tuple[float, float], text: str, *of: object, **more: object) -> None:
        found.append(text)
        draw(self, at, text, *of, **more)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        patched.setattr(ImageDraw.ImageDraw, "text", write)
        maps_sheet(view)
    return found


def test_it_names_object_frame_and_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    two = c.OpenFrame("0/2")
    cases: tuple[tuple[tuple[c.Command, ...], str], ...] = (
        ((c.Step(),), "box, frame 0/1, RIR, iteration 1"),
        ((END,), "box, frame 0/1, RIR, answer after 6 iterations"),
        ((two, c.Step(), c.Focus(1)), "box #1, frame 0/2, RIR, iteration 1"),
        ((two, c.Step(), c.ShowScene()), "all objects, frame 0/2, RIR, iteration 1"),
    )
    for commands, title in cases:
        assert texts(after(*commands), monkeypatch)[0] == title


def test_every_letter_can_be_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    font = ImageFont.load_default(15)
    unknown = np.array(font.getmask("\uffff"))
    letters = set("".join(texts(after(END), monkeypatch))) - set("\n ")
    assert not [x for x in letters if np.array_equal(np.array(font.getmask(x)), unknown)]
