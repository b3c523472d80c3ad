"""The colour term: its definition by plain numpy, its laws, and what it leaves alone."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
import trimesh

from tests.rendering.conftest import MakeVerifier
from tests.rendering.witness import CAMERA, model_of
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel, Texture
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Placed, Target
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.gl_verifier import GlVerifier
from verefine_viz.rendering.rendered_scene import render_scene
from verefine_viz.scenes.demo_models import cuboid

SIZE_M = (0.06, 0.05, 0.12)
T_BOX = transform(axis_angle([1.0, 0.3, 0.2], 1.1), [0.01, 0.0, 0.4])
FLIP = transform(axis_angle([1.0, 0, 0], np.pi), np.zeros(3))
"""Upside down: the same surface."""
W = 0.3


def paint(points: np.ndarray) -> np.ndarray:
    """RGB in [0, 255] of points (…, 3) of the box [m]: smooth, and another one at each end."""
    x, y, z = np.moveaxis(points / np.array(SIZE_M), -1, 0)
    red, green = 0.5 + 0.45 * np.sin(4 * z + 2 * x), 0.5 + 0.4 * np.cos(5 * z - 3 * y)
    return 255 * np.stack([red, green, 0.5 - 0.4 * z], axis=-1)


def bare(obj_id: int = 1) -> ObjectModel:
    mesh = cuboid(SIZE_M, 0.004)
    return model_of(trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False), obj_id)


def painted(obj_id: int = 1) -> ObjectModel:
    return replace(bare(obj_id), vertex_colors=paint(bare().vertices).round())


def uniform() -> ObjectModel:
    return replace(bare(), vertex_colors=np.full((len(bare().vertices), 3), (200, 40, 60)))


def seen_by(models: list[tuple[ObjectModel, np.ndarray]], gain: float = 1.0, offset: float = 0.0) -> list[Target]:
    """Targets of one frame in which the models stand, seen by a sensor with a little noise."""
    picture = render_scene([Placed(k, model, T) for k, (model, T) in enumerate(models)], CAMERA)
    rng = np.random.default_rng(0)
    depth = np.where(picture.depth_m > 0, picture.depth_m + rng.normal(0, 0.001, CAMERA.shape), 0)
    noisy = picture.rgb * gain + offset + rng.normal(0, 2, picture.rgb.shape)
    rgb = np.clip(noisy, 0, 255).astype(np.uint8)
    observation = Observation(CAMERA, depth, picture.normals_cam, rgb, picture.labels >= 0, None)
    return [
        Target(observation, Instance(k, model.obj_id, picture.labels == k, np.zeros((0, 3)), (), T), model)
        for k, (model, T) in enumerate(models)
    ]


def target(model: ObjectModel | None = None, **changes: float) -> Target:
    return seen_by([(model or painted(), T_BOX)], **changes)[0]


def around(n: int, T: np.ndarray = T_BOX, size: float = 1.0) -> np.ndarray:
    """Poses (n, 4, 4): the given one, it upside down, and others nearby."""
    rng = np.random.default_rng(1)
    steps = [transform(axis_angle(rng.normal(size=3), 0.2 * size), rng.normal(0, 0.004 * size, 3)) for _ in range(n)]
    return np.stack([T, T @ FLIP, *(T @ step for step in steps)])[:n]


def correlation(rendered: np.ndarray, observed: np.ndarray) -> float:
    """Of RGB (N, 3) in [0, 1], in the opponent space, all channels together."""
    r, g, b = (np.stack([rendered, observed])[..., k] for k in range(3))
    both = np.stack([(r + g + b) / 6, r - g, (r + g) / 2 - b], axis=-1)
    x, y = both - both.mean(axis=1, keepdims=True)
    return float((x * y).sum() / np.sqrt((x**2).sum() * (y**2).sum()))


def test_it_is_the_correlation_of_the_model_s_and_the_image_s_colours(make: MakeVerifier) -> None:
    one, verifier = target(), make(colour_weight=W)
    Ts = around(8)
    scores = verifier.score(one, Ts)
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    for T, got in zip(Ts, scores.colour_fit, strict=True):
        maps = verifier.maps(one, T)
        explained = maps.classes == 1
        z = maps.rendered_m[explained].astype(float)
        x, y = (u[explained] - CAMERA.cx) / CAMERA.fx * z, (v[explained] - CAMERA.cy) / CAMERA.fy * z
        points = (np.stack([x, y, z], axis=1) - T[:3, 3]) @ T[:3, :3]
        expected = correlation(paint(points) / 255, one.observation.rgb[explained] / 255)
        # The image is smoothed, and the model's colours are those of 2 mm.
        assert got == pytest.approx(expected, abs=0.03)
    assert scores.colour_fit[0] > 0.9
    assert scores.colour_fit[1] < 0


def test_the_score_is_a_mixture_and_its_geometric_parts_are_as_without_colour(make: MakeVerifier) -> None:
    one, Ts = target(), around(8)
    without, with_colour = make().score(one, Ts), make(colour_weight=W).score(one, Ts)
    for name in ("depth_fit", "normal_fit", "n_pixels", "n_rendered", "counts"):
        np.testing.assert_array_equal(getattr(without, name), getattr(with_colour, name))
    expected = (1 - W) * without.score + W * np.maximum(with_colour.colour_fit, 0)
    np.testing.assert_allclose(with_colour.score, expected, atol=1e-12)
    assert with_colour.colour_weight == W
    assert with_colour[0].colour_part == pytest.approx(W * with_colour.colour_fit[0])
    assert with_colour[1].colour_part == 0, "a negative correlation adds nothing"


def test_of_two_poses_that_depth_cannot_tell_apart_colour_chooses_the_right_one(make: MakeVerifier) -> None:
    one, Ts = target(), around(2)
    assert abs(np.diff(make().score(one, Ts).score)[0]) < 0.01
    right, upside_down = make(colour_weight=W).score(one, Ts).score
    assert right > upside_down + 0.2


def test_weight_0_is_the_score_of_a_model_without_colours(make: MakeVerifier) -> None:
    one, Ts = target(), around(8)
    colourless = Target(one.observation, one.instance, bare())
    for w in (0.0, W):
        scores = make(colour_weight=w).score(one if w == 0 else colourless, Ts)
        assert scores.colour_fit is None
        assert scores[0].colour_fit is None
        assert scores[0].colour_part == 0
        np.testing.assert_array_equal(scores.score, make().score(colourless, Ts).score)
    maps = make(colour_weight=W).maps(colourless, T_BOX)
    assert maps.correlation is None
    assert maps.rendered_rgb is None


def test_without_print_or_image_there_is_no_term(make: MakeVerifier) -> None:
    one, Ts = target(uniform()), around(8)
    scores = make(colour_weight=W).score(one, Ts)
    assert scores.colour_fit is None
    np.testing.assert_array_equal(scores.score, make().score(one, Ts).score)
    one = target()
    grey = Target(replace(one.observation, rgb=None), one.instance, one.model)
    assert make(colour_weight=W).score(grey, Ts[:3]).colour_fit is None


def test_gain_and_offset_of_the_image_hardly_matter(make: MakeVerifier) -> None:
    verifier, Ts = make(colour_weight=W), around(8)
    for gain, offset in ((0.6, 0.0), (0.7, 60.0), (0.4, 20.0)):
        plain, changed = (verifier.score(t, Ts).colour_fit for t in (target(), target(gain=gain, offset=offset)))
        assert plain is not None
        assert changed is not None
        np.testing.assert_allclose(changed, plain, atol=0.03)


def test_a_texture_leaves_the_depth_alone_and_has_the_term_of_the_same_colours_at_the_vertices(
    make: MakeVerifier,
) -> None:
    plain = painted()
    # Every face shows its own 8 × 8 pixels of the image, painted as the face is.
    n, side = len(plain.faces), 8
    a, b = np.meshgrid((np.arange(side) + 0.5) / side, 1 - (np.arange(side) + 0.5) / side)
    corners = plain.vertices[plain.faces]
    steps = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    points = corners[:, None, None, 0] + a[..., None] * steps[0][:, None, None] + b[..., None] * steps[1][:, None, None]
    image = np.clip(paint(points).round(), 0, 255).astype(np.uint8).transpose(1, 0, 2, 3).reshape(side, n * side, 3)
    uv = np.stack([np.array([[k, 0], [k + 1, 0], [k, n]]) / n for k in range(n)])
    textured = replace(bare(), texture=Texture(image, uv.astype(np.float32)))
    one = target(plain)
    other = Target(one.observation, one.instance, textured)
    verifier, Ts = make(colour_weight=W), around(6)
    for T in Ts:
        np.testing.assert_array_equal(verifier.maps(one, T).rendered_m, verifier.maps(other, T).rendered_m)
    by_vertices, by_texture = verifier.score(one, Ts).colour_fit, verifier.score(other, Ts).colour_fit
    assert by_vertices is not None
    assert by_texture is not None
    np.testing.assert_allclose(by_texture, by_vertices, atol=0.02)


def test_maps_are_the_term_pixel_by_pixel(make: MakeVerifier) -> None:
    one, Ts, verifier = target(), around(6), make(colour_weight=W)
    scores = verifier.score(one, Ts)
    for T, score in zip(Ts, scores, strict=False):
        maps = verifier.maps(one, T)
        explained = maps.classes == 1
        assert np.array_equal(np.isfinite(maps.correlation), explained)
        counted = explained & ((np.indices(explained.shape).sum(axis=0) % 2) == 0)
        assert maps.correlation[counted].mean() == pytest.approx(score.colour_fit, abs=1e-3)
        assert maps.correlation[explained].mean() == pytest.approx(score.colour_fit, abs=0.02)
        assert not maps.rendered_rgb[maps.rendered_m == 0].any()
    maps = verifier.maps(one, T_BOX)
    explained = maps.classes == 1
    assert maps.rendered_rgb is not None
    assert maps.observed_rgb is not None
    seen, drawn = (image[explained].astype(float) for image in (maps.observed_rgb, maps.rendered_rgb))
    # They differ by the light alone.
    assert correlation(drawn / 255, seen / 255) > 0.9


def test_a_scene_s_term_is_that_of_its_objects_by_the_pixels_of_their_masks(make: MakeVerifier) -> None:
    T_left, T_right = (transform(T_BOX[:3, :3], [x, 0.0, 0.42]) for x in (-0.07, 0.07))
    both = seen_by([(painted(1), T_left), (painted(2), T_right)])
    verifier = make(colour_weight=W)
    combined = np.stack([[T_left, T_right], [T_left @ FLIP, T_right]])
    scene = verifier.score_scene(both, combined)
    alone = [verifier.score(t, combined[:, k]).colour_fit for k, t in enumerate(both)]
    n = np.array([np.count_nonzero(t.instance.mask & (t.observation.depth_m > 0)) for t in both])
    assert scene.colour_fit is not None
    np.testing.assert_allclose(scene.colour_fit, np.array(alone).T @ n / n.sum(), atol=1e-3)
    # An object without colours takes its share of the weight with it.
    half = [both[0], Target(both[1].observation, both[1].instance, bare(2))]
    mixed = verifier.score_scene(half, combined)
    assert mixed.colour_weight == pytest.approx(W * n[0] / n.sum())
    assert mixed.colour_fit is not None
    assert alone[0] is not None
    np.testing.assert_allclose(mixed.colour_fit, alone[0], atol=1e-3)
    maps = verifier.scene_maps(half, combined[0])
    assert maps.correlation is not None
    assert np.isfinite(maps.correlation).sum() < (maps.classes == 1).sum()


def test_a_batch_has_the_bits_of_its_poses_one_by_one() -> None:
    one, Ts, verifier = target(), around(30), CpuVerifier(coloured())
    together = verifier.score(one, Ts).score
    assert together.tobytes() == np.concatenate([verifier.score(one, T[None]).score for T in Ts]).tobytes()


def coloured(**fields: object) -> ScoreSettings:
    return msgspec.convert({"colour_weight": W, **fields}, ScoreSettings)


def test_both_verifiers_agree(needs_gl: None) -> None:
    T_left, T_right = (transform(T_BOX[:3, :3], [x, 0.0, 0.42]) for x in (-0.05, 0.05))
    both = seen_by([(painted(1), T_left), (painted(2), T_right)])
    for pixels in ("classes", "observed", "published"):
        settings = coloured(pixels=pixels)
        cpu, gl = CpuVerifier(settings), GlVerifier(settings)
        try:
            Ts = around(20, T_left)
            a, b = cpu.score(both[0], Ts), gl.score(both[0], Ts)
            combined = np.stack([Ts, around(20, T_right)], axis=1)
            c, d = cpu.score_scene(both, combined), gl.score_scene(both, combined)
        finally:
            gl.close()
        for one, other in ((a, b), (c, d)):
            assert one.colour_fit is not None
            assert other.colour_fit is not None
            assert np.abs(one.colour_fit - other.colour_fit).max() < 3e-3, pixels
            assert np.abs(one.score - other.score).max() < 3e-3, pixels


def test_poses_that_show_nothing_have_no_correlation(make: MakeVerifier) -> None:
    behind, nowhere = transform(np.eye(3), [0, 0, -1.0]), np.full((4, 4), np.nan)
    scores = make(colour_weight=W).score(target(), np.stack([behind, nowhere]))
    assert not scores.colour_fit.any()
    assert not scores.score.any()
