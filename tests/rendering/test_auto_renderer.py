"""Which renderer ``auto`` takes on a GPU, by stand-ins for what is measured."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.rendering.witness import disturbed, target_of
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering import auto_renderer, gl_context
from verefine_viz.rendering.auto_renderer import LARGE, BySize, RendererTimes, measured, times_on
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.gl_context import GlInfo
from verefine_viz.rendering.registry import make_verifier

GPU = GlInfo("some GPU", "some vendor", "4.6 driver 1", is_software=False)
CPU_MS = 0.4, 8.0
CHOICES = {
    "cpu": RendererTimes(CPU_MS, (3.0, 9.0), 1e-6),
    "gl": RendererTimes(CPU_MS, (0.3, 0.7), 1e-6),
    "auto": RendererTimes(CPU_MS, (0.5, 0.7), 1e-6),
}
"""Times, and the name of the verifier that follows."""


@pytest.mark.parametrize("expected", CHOICES)
def test_auto_takes_what_is_faster(expected: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl_context, "probe", lambda: GPU)
    monkeypatch.setattr(auto_renderer, "times_on", lambda _: CHOICES[expected])
    assert make_verifier(ScoreSettings()).name == expected


def test_a_gl_that_fails_or_differs_is_not_taken() -> None:
    for times in (RendererTimes(CPU_MS, (math.inf, math.inf), math.inf), RendererTimes(CPU_MS, (0.01, 0.01), 0.2)):
        assert not any(times.takes_gl(n) for n in (0, 1, LARGE, 1000))
        assert "the CPU" in times.in_words


def test_each_driver_is_measured_once(tmp_path: Path) -> None:
    calls: list[str] = []

    def first() -> RendererTimes:
        calls.append("first")
        return CHOICES["auto"]

    def second() -> RendererTimes:
        calls.append("second")
        return CHOICES["gl"]

    assert times_on(GPU, first, tmp_path) == CHOICES["auto"]
    assert times_on(GPU, second, tmp_path) == CHOICES["auto"], "as another process would find it"
    newer = GlInfo(GPU.renderer, GPU.vendor, "4.6 driver 2", is_software=False)
    assert times_on(newer, second, tmp_path) == CHOICES["gl"]
    assert calls == ["first", "second"]


def test_the_size_of_a_batch_alone_says_who_scores_it() -> None:
    # Two rules of the score stand for the two renderers: whose bits they are can be seen.
    few, many = (CpuVerifier(ScoreSettings(simplify_mm=0, pixels=pixels)) for pixels in ("observed", "classes"))
    both, target = BySize(few, many, CHOICES["auto"]), target_of()
    for n in (LARGE, 1, LARGE - 1, LARGE + 1, 1, LARGE):
        Ts, by = disturbed(n), many if n >= LARGE else few
        expected = by.score(target, Ts).score.tobytes()
        assert both.score(target, Ts).score.tobytes() == expected
        assert both.score_scene((target,), Ts[:, None], whole_frame=True).score.tobytes() == expected
        begun = both.begin(target, Ts)
        assert begun is None or begun().score.tobytes() == expected
    one, maps = few.maps(target, disturbed(1)[0]), both.maps(target, disturbed(1)[0])
    assert maps is not None
    assert np.array_equal(maps.counted, one.counted)


@pytest.mark.usefixtures("needs_gl")
def test_measuring_compares_the_renderers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(auto_renderer, "SIZES", (1, 4))
    monkeypatch.setattr(auto_renderer, "REPEATS", 1)
    times = measured()
    assert times.difference < 3e-4
    assert min(*times.cpu_ms, *times.gl_ms) > 0
