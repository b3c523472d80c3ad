"""Looking into a report's HTML, and filling one as far as it goes."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
import pytest

from verefine_viz.pictures.answer_pictures import HEIGHT_PX, WIDTH_PX, Pictures, data_uri
from verefine_viz.report import failure_cards as gallery
from verefine_viz.report.failure_cards import ScoreCurve

GONE = {"title": "Gone", "scene": {"source": "bop", "dataset": "/nowhere/at/all"}}
"""A session whose data set is not there any more."""


def figures(html: str) -> dict[str, dict[str, Any]]:
    """Every chart's JSON by id."""
    found = re.findall(r'<script type="application/json" id="figure-([\w-]+)">(.*?)</script>', html, re.DOTALL)
    return {name: json.loads(text) for name, text in found}


def without_plotly(html: str) -> str:
    """A page without the library that draws its charts."""
    return re.sub(r"<script>/\*.*?</script>", "", html, count=1, flags=re.DOTALL)


def size_of_1000_frames(size_of_50: int, size_of_100: int) -> float:
    """The size of a page if it goes on growing as it does from 50 frames to 100 [bytes]."""
    return size_of_100 + (1000 - 100) * (size_of_100 - size_of_50) / 50


def fill_cards(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gives every card of a gallery the largest pictures and the longest curve."""
    rng = np.random.default_rng(0)
    # Noise is what compresses worst: no frame can make larger pictures.
    noise = [data_uri(rng.integers(0, 256, (HEIGHT_PX, WIDTH_PX, 3), np.uint8)) for _ in range(2)]
    ks = tuple(range(1, 251))
    curve = ScoreCurve(ks, (0,) * 250, tuple(0.1234 + k / 1e3 for k in ks), tuple(k / 250 for k in ks), (3.25,) * 250)
    monkeypatch.setattr(gallery, "_pictures", lambda *_: Pictures(noise[0], noise[1]))
    monkeypatch.setattr(gallery, "_curves", lambda *_: dict.fromkeys(range(6), curve))
