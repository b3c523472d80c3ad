"""The OpenGL verifier: the same numbers as the CPU's, and manners of its own."""

from __future__ import annotations

import gc
import threading

import msgspec
import numpy as np
import pytest

from tests.rendering.witness import T_BOX, T_TABLE, T_TORUS, box, disturbed, shell, table, target_of
from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering import gl_context, gl_passes
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.gl_context import GlInfo, gl_info, gl_problem
from verefine_viz.rendering.gl_verifier import GlVerifier
from verefine_viz.rendering.registry import make_verifier


@pytest.mark.usefixtures("needs_gl")
def test_both_verifiers_agree() -> None:
    frame = target_of()
    placed = [Placed(7, box(), T_BOX), Placed(8, table(), T_TABLE)]
    for pixels in ("published", "observed", "classes"):
        settings = msgspec.convert({"pixels": pixels, "simplify_mm": 0}, ScoreSettings)
        cpu, gl = CpuVerifier(settings), GlVerifier(settings)
        for target in (frame, Target(frame.observation, frame.instance, shell())):
            Ts = disturbed(30, seed=11)
            for others in ((), placed):
                a, b = cpu.score(target, Ts, others), gl.score(target, Ts, others)
                assert np.abs(a.score - b.score).max() < 3e-4, pixels
                assert np.abs(a.counts - b.counts).max() <= 3, pixels
                assert np.abs(a.n_pixels - b.n_pixels).max() <= 3, pixels
            x, y = cpu.maps(target, Ts[3], placed), gl.maps(target, Ts[3], placed)
            both = (x.rendered_m > 0) & (y.rendered_m > 0)
            assert ((x.rendered_m > 0) != (y.rendered_m > 0)).sum() <= 3, pixels
            assert (np.abs(x.rendered_m - y.rendered_m)[both] > 1e-4).sum() <= 3, pixels
            assert (x.classes != y.classes).sum() <= 6, pixels
        gl.close()


@pytest.mark.usefixtures("needs_gl")
def test_a_pose_across_the_camera_plane_is_clipped_alike() -> None:
    settings = ScoreSettings(simplify_mm=0, pixels="observed")
    cpu, gl = CpuVerifier(settings), GlVerifier(settings)
    T = transform(axis_angle([1, 2, 0], 0.7), [0.01, 0, 0.02])
    a, b = (v.score(target_of(), np.stack([T, T_TORUS])) for v in (cpu, gl))
    assert a.n_rendered[0] > 1000
    assert np.abs(a.n_rendered - b.n_rendered).max() <= 0.002 * a.n_rendered.max()
    assert np.abs(a.score - b.score).max() < 1e-3
    gl.close()


@pytest.mark.usefixtures("needs_gl")
def test_a_pose_scores_the_same_in_every_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    gl, target = GlVerifier(ScoreSettings(simplify_mm=0)), target_of()
    Ts = disturbed(20)
    together = gl.score(target, Ts)
    assert (
        np.concatenate([gl.score(target, Ts[k : k + 1]).score for k in range(20)]).tobytes() == together.score.tobytes()
    )
    for name, most in (("BATCH_PIXELS", 1), ("BATCH_PIXELS", 60_000), ("MOST_GROUPS", 3)):
        with monkeypatch.context() as patch:
            patch.setattr(gl_passes, name, most)
            assert gl.score(target, Ts).score.tobytes() == together.score.tobytes(), (name, most)
    gl.close()


@pytest.mark.usefixtures("needs_gl")
def test_forgotten_targets_are_released_and_answers_stay_the_same() -> None:
    gl = GlVerifier(ScoreSettings(simplify_mm=0))
    Ts = disturbed(4)
    first = gl.score(target_of(), Ts)
    for seed in range(3):
        gl.score(target_of(seed), Ts)
        gc.collect()
    assert len(gl._passes._targets) <= 1  # pyright: ignore[reportOptionalMemberAccess]
    assert gl.score(target_of(), Ts).score.tobytes() == first.score.tobytes()
    gl.close()


@pytest.mark.usefixtures("needs_gl")
def test_several_verifiers_may_live_in_one_thread() -> None:
    a, b = (
        GlVerifier(msgspec.convert({"simplify_mm": 0, "pixels": p}, ScoreSettings)) for p in ("observed", "classes")
    )
    Ts = disturbed(3)
    before = a.score(target_of(), Ts).score, b.score(target_of(), Ts).score
    after = a.score(target_of(), Ts).score, b.score(target_of(), Ts).score
    assert np.array_equal(before, after)
    assert np.abs(before[0] - before[1]).max() > 0
    a.close()
    assert np.array_equal(b.score(target_of(), Ts).score, before[1])
    b.close()


@pytest.mark.usefixtures("needs_gl")
def test_another_thread_is_reported_whose_it_is() -> None:
    gl = GlVerifier(ScoreSettings(simplify_mm=0))
    gl.score(target_of(), disturbed(1))
    caught: list[BaseException] = []

    def use() -> None:
        try:
            gl.score(target_of(), disturbed(1))
        except UnavailableError as error:
            caught.append(error)

    thread = threading.Thread(target=use, name="other")
    thread.start()
    thread.join()
    assert "belongs to thread 'MainThread'" in str(caught[0])
    assert "called from thread 'other'; make one verifier per thread" in str(caught[0])
    gl.close()


@pytest.mark.usefixtures("needs_gl")
def test_it_may_be_made_in_one_thread_and_used_in_another() -> None:
    gl, scores = GlVerifier(ScoreSettings(simplify_mm=0)), []

    def use() -> None:
        scores.append(gl.score(target_of(), disturbed(2)))
        gl.close()

    thread = threading.Thread(target=use)
    thread.start()
    thread.join()
    assert scores[0].score[0] > 0.5


@pytest.mark.usefixtures("needs_gl")
def test_what_was_found_is_named() -> None:
    info = gl_info()
    assert info.renderer
    assert info.version
    assert gl_problem() is None


def test_software_gl_is_used_only_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    info = GlInfo("llvmpipe", "some vendor", "4.5", is_software=True)
    monkeypatch.setattr(gl_context, "probe", lambda: info)
    settings = [msgspec.convert({"renderer": name}, ScoreSettings) for name in ("auto", "gl", "cpu")]
    assert [make_verifier(s).name for s in settings] == ["cpu", "gl", "cpu"]


def test_without_gl_auto_is_the_cpu_and_gl_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(**_: object) -> None:
        raise OSError("libEGL.so.1: cannot open\nshared object file")

    monkeypatch.setattr(gl_context.moderngl, "create_context", fail)
    gl_context.probe.cache_clear()
    try:
        assert make_verifier(ScoreSettings()).name == "cpu"
        assert gl_info() is None
        with pytest.raises(UnavailableError) as caught:
            make_verifier(ScoreSettings(renderer="gl"))
        assert "no OpenGL 4.3 context could be made (libEGL.so.1: cannot open shared object file)" in str(caught.value)
        assert "install EGL" in str(caught.value)
        assert "\n" not in str(caught.value)
        assert gl_problem() == str(caught.value)
    finally:
        gl_context.probe.cache_clear()
