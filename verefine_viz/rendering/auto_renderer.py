"""Which renderer ``auto`` takes on a machine with a GPU: measured once, for few poses and for many apart.

Which is faster cannot be known beforehand: a GPU has a fixed cost per call, a processor has 2 cores or 100.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median
from time import perf_counter

import moderngl
import numpy as np
import platformdirs

from verefine_viz.core.array_cache import Arrays, cached
from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Placed, Target
from verefine_viz.core.processor import processor_name
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.scores import PixelGrid, ScoreMaps, Scores
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.gl_context import GlInfo
from verefine_viz.rendering.gl_verifier import GlVerifier

SIZES = (1, 100)
"""Numbers of poses of the two batches that are timed."""

LARGE = 10
"""A batch of this many poses goes where 100 are faster, a smaller one where one is: ten times 1, a tenth of 100."""

REPEATS = 5

LARGEST_DIFFERENCE = 1e-3
"""Largest difference between scores of the two renderers; an OpenGL that differs by more is not used."""

DISTANCE_M = 0.5


@dataclass(frozen=True)
class RendererTimes:
    """The times measured on a machine."""

    cpu_ms: tuple[float, float]
    """Time for a batch of each of ``SIZES`` [ms]."""
    gl_ms: tuple[float, float]
    """On OpenGL [ms]; infinite where it fails."""
    difference: float
    """Largest difference between the scores of both."""

    def takes_gl(self, n_poses: int) -> bool:
        """Whether a batch is scored on OpenGL: it depends on the batch's size alone."""
        k = int(n_poses >= LARGE)
        return self.difference <= LARGEST_DIFFERENCE and self.gl_ms[k] < self.cpu_ms[k]

    @property
    def in_words(self) -> str:
        """A sentence on what ``auto`` takes, and why."""
        few, many = self.takes_gl(1), self.takes_gl(LARGE)
        names = {False: "the CPU", True: "OpenGL"}
        taken = names[few] if few == many else f"{names[few]} below {LARGE} poses at once, {names[many]} from there on"
        if not np.isfinite(self.gl_ms).all():
            return f"it fails to score poses, so auto takes {taken}"
        if self.difference > LARGEST_DIFFERENCE:
            return f"its scores differ from the CPU's by {self.difference:.2g}, so auto takes {taken}"
        ms = (f"{cpu:.2g} and {gl:.2g} ms" for cpu, gl in zip(self.cpu_ms, self.gl_ms, strict=True))
        sizes = (f"{n} {'pose' if n == 1 else 'poses'}: {pair}" for n, pair in zip(SIZES, ms, strict=True))
        return f"auto takes {taken}; CPU and OpenGL, {', '.join(sizes)}"


@cache
def times_on(
    gl: GlInfo, measure: Callable[[], RendererTimes] | None = None, folder: Path | None = None
) -> RendererTimes:
    """The times of a GPU and this processor, measured by the first process that asks and cached on disk.

    The number of threads is no key: workers of a batch have fewer, and must choose alike.

    Args:
        gl: the GPU and its driver.
        measure: measures; None = :func:`measured`.
        folder: the cache; None = that of the user.
    """
    name = hashlib.sha256(f"{gl.renderer}\n{gl.version}\n{processor_name()}".encode()).hexdigest()[:16]
    return cached(
        (folder or platformdirs.user_cache_path("verefine-viz") / "renderers") / f"{name}.npz",
        measure or measured,
        _unpacked,
        lambda times: {"cpu_ms": times.cpu_ms, "gl_ms": times.gl_ms, "difference": times.difference},
        lambda _: None,
        preparing="",
        waiting="",
    )


def measured() -> RendererTimes:
    """Scores a made-up object with both renderers, one pose and 100: some ten ms, compilation aside."""
    target, settings = _made_up_target(), ScoreSettings(simplify_mm=0)
    batches = [_poses(n) for n in SIZES]
    cpu, gl = CpuVerifier(settings), GlVerifier(settings)
    cpu_ms = _ms(cpu, target, batches)
    try:
        gl_ms = _ms(gl, target, batches)
        scores = [verifier.score(target, batches[-1]).score for verifier in (cpu, gl)]
        gl.close()
    except (UnavailableError, moderngl.Error):
        return RendererTimes(cpu_ms, (np.inf, np.inf), np.inf)
    return RendererTimes(cpu_ms, gl_ms, float(np.abs(scores[0] - scores[1]).max()))


def fastest(settings: ScoreSettings, times: RendererTimes, progress: ProgressToken = NEVER_CANCELLED) -> Verifier:
    """The verifier that was measured to be fastest, or both where that depends on the number of poses.

    Args:
        settings: of the score.
        times: measured on this machine.
        progress: asked where the mesh of a model has to be made.
    """
    if times.takes_gl(1) != times.takes_gl(LARGE):
        return BySize(CpuVerifier(settings, progress=progress), GlVerifier(settings, progress=progress), times)
    kind = GlVerifier if times.takes_gl(1) else CpuVerifier
    return kind(settings, progress=progress)


class BySize:
    """A verifier (core.protocols) made of two: each batch goes to the one that is faster for its number of poses.

    Args:
        cpu: scores some batches.
        gl: scores the others.
        times: say which.
    """

    name = "auto"

    def __init__(self, cpu: Verifier, gl: Verifier, times: RendererTimes) -> None:
        self.settings = cpu.settings
        self._cpu, self._gl, self._times = cpu, gl, times

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        """As the verifier for so many poses."""
        return self._for(len(Ts_cam_obj)).score(target, Ts_cam_obj, placed)

    def begin(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Callable[[], Scores] | None:
        """As the verifier for so many poses."""
        return self._for(len(Ts_cam_obj)).begin(target, Ts_cam_obj, placed)

    def maps(
        self, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = (), at: PixelGrid | None = None
    ) -> ScoreMaps | None:
        """As the verifier for one pose."""
        return self._for(1).maps(target, T_cam_obj, placed, at)

    def score_scene(
        self, targets: Sequence[Target], Ts_cam_obj: Float, placed: Sequence[Placed] = (), whole_frame: bool = False
    ) -> Scores:
        """As the verifier for so many combinations."""
        return self._for(len(Ts_cam_obj)).score_scene(targets, Ts_cam_obj, placed, whole_frame)

    def scene_maps(
        self,
        targets: Sequence[Target],
        Ts_cam_obj: Float,
        placed: Sequence[Placed] = (),
        *,
        at: PixelGrid | None = None,
    ) -> ScoreMaps | None:
        """As the verifier for one combination."""
        return self._for(1).scene_maps(targets, Ts_cam_obj, placed, at=at)

    def _for(self, n: int) -> Verifier:
        return self._gl if self._times.takes_gl(n) else self._cpu


def _made_up_target() -> Target:
    """A ball of 2 000 triangles, 140 pixels across, in front of a wall: like an object on a table."""
    turns, heights = np.meshgrid(np.linspace(0, 2 * np.pi, 45)[:-1], np.linspace(0, np.pi, 25))
    vertices = 0.06 * np.stack(
        [np.sin(heights) * np.cos(turns), np.sin(heights) * np.sin(turns), np.cos(heights)], axis=-1
    )
    corner = np.arange(vertices.size // 3).reshape(heights.shape)
    a, b, c, d = corner[:-1], np.roll(corner[:-1], -1, 1), np.roll(corner[1:], -1, 1), corner[1:]
    faces = np.concatenate(
        [np.stack([a, d, c], -1).reshape(-1, 3), np.stack([a, c, b], -1).reshape(-1, 3)], dtype=np.int32
    )
    points = vertices.reshape(-1, 3)
    model = ObjectModel(0, "ball", points, faces, points, points / 0.06, 0.12, np.eye(4)[None])
    camera = Camera(np.array([[580.0, 0, 119.5], [0, 580.0, 119.5], [0, 0, 1]]), 240, 240)
    v, u = np.mgrid[:240, :240]
    mask = np.hypot(u - 119.5, v - 119.5) < 70
    depth = np.where(mask, DISTANCE_M - 0.03, DISTANCE_M + 0.1).astype(np.float32)
    normals = np.broadcast_to(np.array([0, 0, -1], np.float32), (*camera.shape, 3))
    observation = Observation(camera, depth, normals, None, mask, None)
    return Target(observation, Instance(0, 0, mask, np.zeros((0, 3)), ()), model)


def _poses(n: int) -> Float:
    """(n, 4, 4) the ball in front of the camera, turned and moved a little."""
    rng = np.random.default_rng(0)
    moves = rng.normal([0, 0, DISTANCE_M], 0.005, (n, 3))
    return np.stack([transform(axis_angle([1, 2, 3], k / 10), t) for k, t in enumerate(moves)])


def _ms(verifier: Verifier, target: Target, batches: Sequence[Float]) -> tuple[float, float]:
    """Medians for each batch [ms]; the first call, which prepares, does not count."""

    def once(Ts: Float) -> float:
        start = perf_counter()
        verifier.score(target, Ts)
        return 1e3 * (perf_counter() - start)

    verifier.score(target, batches[-1])
    one, many = (median(once(Ts) for _ in range(REPEATS)) for Ts in batches)
    return one, many


def _unpacked(arrays: Arrays) -> RendererTimes:
    cpu, gl = (tuple(float(ms) for ms in arrays[name]) for name in ("cpu_ms", "gl_ms"))
    return RendererTimes((cpu[0], cpu[1]), (gl[0], gl[1]), float(arrays["difference"]))
