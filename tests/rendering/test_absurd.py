"""No camera, pose or mesh makes the rasteriser touch memory that is not its own: a crash would take all with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.fakes import box_problem
from tests.rendering.witness import box, torus
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Target
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.evaluation.bop_model import EvalModel
from verefine_viz.evaluation.vsd import EMPTY, model_depth, vsd
from verefine_viz.observation.normals import estimate_normals
from verefine_viz.rendering import score_kernels
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.mesh import render_mesh, render_meshes
from verefine_viz.rendering.rasterizer import clamped, draw_depth, draw_frame

HEIGHT, WIDTH = 30, 40
AROUND = 1_000
"""Numbers on both sides of an image that must stay as they are."""
TORUS = render_mesh(torus().vertices, torus().faces)
HUGE = (1e6, 1e15, 9.3e18, 1e19, 1e22, 1e99, 1.7e308)
TINY = (0.0, 1e-300, 1e-22, 1e-6)

numbers = st.one_of(
    st.sampled_from([*HUGE, *(-x for x in HUGE), *TINY, float("nan"), float("inf"), -float("inf")]),
    st.floats(-1e4, 1e4),
    st.floats(allow_nan=True, allow_infinity=True),
)
focal = st.one_of(st.floats(1.0, 1e3), st.sampled_from([*HUGE, *TINY[1:]]), st.floats(1e-300, 1.7e308))
sane_or_not = st.one_of(st.floats(-0.2, 0.2), st.floats(-1e6, 1e6), numbers)
poses = st.builds(
    lambda angle, x, y, z, stretch: stretch_of(transform(axis_angle([1, 2, 3], angle), [x, y, z]), stretch),
    st.floats(0, 3),
    sane_or_not,
    sane_or_not,
    st.one_of(st.floats(-0.1, 0.7), sane_or_not),
    st.one_of(st.just(1.0), numbers),
)


def stretch_of(T: np.ndarray, stretch: float) -> np.ndarray:
    with np.errstate(all="ignore"):
        T[:3, :3] *= stretch
    return T


class Fenced:
    """An image with numbers around it that must not change."""

    def __init__(self, dtype: type[np.generic]) -> None:
        self._all = np.zeros(HEIGHT * WIDTH + 2 * AROUND, dtype)
        self.image = self._all[AROUND:-AROUND].reshape(HEIGHT, WIDTH)

    @property
    def is_intact(self) -> bool:
        return not (self._all[:AROUND].any() or self._all[-AROUND:].any())


@settings(max_examples=300)
@given(T=poses, fx=numbers, fy=numbers, cx=numbers, cy=numbers)
@example(T=transform(np.eye(3), [0, 0, 0.5]), fx=1e99, fy=600.0, cx=20.0, cy=15.0)
@example(T=transform(np.eye(3), [0.3, 0, 0.5]), fx=1e22, fy=600.0, cx=20.0, cy=15.0)
@example(T=transform(np.eye(3), [0, 0, 0.03]), fx=1e22, fy=-1e22, cx=20.0, cy=15.0)
def test_drawing_stays_within_the_image(T: np.ndarray, fx: float, fy: float, cx: float, cy: float) -> None:
    inv_z, face_of, depth = Fenced(np.float32), Fenced(np.int32), Fenced(np.float32)
    draw_frame(T, *TORUS.arrays, fx, fy, cx, cy, inv_z.image, face_of.image)
    draw_depth(T, *TORUS.arrays, fx, fy, cx, cy, depth.image)
    assert inv_z.is_intact
    assert face_of.is_intact
    assert depth.is_intact
    windows = score_kernels.windows(T[None, None], render_meshes((TORUS,)).arrays, (fx, fy, cx, cy), HEIGHT, WIDTH)
    x0, y0, columns, rows = windows[0, 0].tolist()
    assert 0 <= x0 <= x0 + columns <= WIDTH
    assert 0 <= y0 <= y0 + rows <= HEIGHT


PROBLEM = box_problem()
VERIFIER = CpuVerifier(ScoreSettings())
BOX = EvalModel(1, 1e3 * box().vertices, box().faces, 100.0, np.eye(4)[None])


@settings(max_examples=100)
@given(T=poses, fx=focal, fy=focal, cx=st.floats(-1e300, 1e300), cy=sane_or_not)
@example(T=transform(np.eye(3), [0, 0, 0.5]), fx=1e99, fy=600.0, cx=20.0, cy=15.0)
def test_scores_and_errors_come_out_of_any_camera(T: np.ndarray, fx: float, fy: float, cx: float, cy: float) -> None:
    if not (np.isfinite(T).all() and np.isfinite(cy)):
        return
    shape = PROBLEM.observation.camera.shape
    camera = Camera(np.array([[600.0, 0, 20], [0, 600, 15], [0, 0, 1]]), shape[1], shape[0])
    # A camera refuses such numbers itself; the kernels must not rely on it.
    object.__setattr__(camera, "K", np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]))
    observation = replace(PROBLEM.observation, camera=camera)
    target = Target(observation, PROBLEM.instances[0], PROBLEM.targets[0].model)
    with np.errstate(all="ignore"):
        scores = VERIFIER.score(target, T[None])
        maps = VERIFIER.maps(target, T)
        normals = estimate_normals(observation.depth_m, camera)
        depth = model_depth(BOX, T[:3, :3], 1e3 * T[:3, 3], camera.K, shape)
        errors = vsd(1e3 * observation.depth_m, depth, EMPTY, camera.K, 100.0)
    assert 0 <= scores.score[0] <= 1 + 1e-6
    assert maps.rendered_m.shape == normals.shape[:2] == shape
    assert ((errors >= 0) & (errors <= 1)).all()


@given(x=numbers)
def test_what_becomes_an_index_is_clamped_whatever_it_is(x: float) -> None:
    expected = 3 if np.isnan(x) else int(np.clip(x, 3, 9))
    assert clamped(x, 3, 9) == expected
