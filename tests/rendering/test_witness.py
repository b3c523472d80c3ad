"""Depth, normals, scores and classes against open3d's ray casting and plain numpy."""

from __future__ import annotations

import itertools

import msgspec
import numpy as np
import pytest

from tests.rendering.conftest import MakeVerifier
from tests.rendering.witness import (
    CAMERA,
    T_BOX,
    T_TORUS,
    away_from_silhouettes,
    box,
    cast,
    disturbed,
    reference,
    shell,
    target_of,
)
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.settings import ScoreSettings

MODES = ["published", "observed", "classes"]


def test_depth_and_normals_are_those_of_ray_casting(make: MakeVerifier) -> None:
    target = target_of()
    for T in list(disturbed(6, seed=3)):
        maps = make().maps(target, T)
        depth, normals, _ = cast([(target.model, T)], CAMERA)
        inner = away_from_silhouettes(depth)
        assert inner.sum() > 1000, T
        assert np.abs(maps.rendered_m - depth)[inner].max() < 1e-4, T
        # Only pixels whose ray meets the border of the shape within a hundredth of a pixel may fall to either side.
        assert ((maps.rendered_m > 0) != (depth > 0)).sum() <= 2, T
        # Along an edge between two faces either face is right.
        assert (np.abs(maps.rendered_normals - normals)[inner].max(axis=1) > 1e-3).mean() < 0.01, T


def test_the_inside_of_an_open_shell_is_drawn(make: MakeVerifier) -> None:
    model = shell()
    T = transform(axis_angle([1, 0, 0], np.pi + 0.3), [0, 0, 0.4])
    target = target_of()
    maps = make().maps(Target(target.observation, target.instance, model), T)
    depth, normals, _ = cast([(model, T)], CAMERA)
    inner = away_from_silhouettes(depth)
    assert np.abs(maps.rendered_m - depth)[inner].max() < 1e-4
    assert (np.abs(maps.rendered_normals - normals)[inner].max(axis=1) > 1e-3).mean() < 0.02


def test_scores_and_classes_are_the_formula_s(make: MakeVerifier) -> None:
    target, Ts = target_of(), disturbed(12)
    for alpha, pixels in itertools.product((0.707, 0.293), MODES):
        settings = msgspec.convert({"pixels": pixels, "alpha": alpha, "simplify_mm": 0}, ScoreSettings)
        got = make(pixels=pixels, alpha=alpha).score(target, Ts)
        for i, T in enumerate(Ts):
            expected = reference(target, T, settings)
            assert got.score[i] == pytest.approx(expected["score"], abs=3e-4), (pixels, alpha)
            assert np.abs(got.counts[i] - expected["counts"]).max() <= 2, (pixels, alpha)
            assert abs(int(got.n_pixels[i]) - expected["n"]) <= 2, (pixels, alpha)


def test_the_published_preset_looks_through_shifted_pixels(make: MakeVerifier) -> None:
    # docs/methods.md 1.8.17: the authors' pixel i looks along i + 1/2.
    target, Ts = target_of(), disturbed(5)
    settings = ScoreSettings(pixels="published", pixel_centre="half", simplify_mm=0)
    got = make(pixels="published", pixel_centre="half").score(target, Ts)
    plain = make(pixels="published").score(target, Ts)
    for i, T in enumerate(Ts):
        assert got.score[i] == pytest.approx(reference(target, T, settings)["score"], abs=3e-4)
    assert np.abs(got.score - plain.score).max() > 1e-3


def test_placed_objects_hide_what_lies_behind_them(make: MakeVerifier) -> None:
    target, Ts = target_of(), disturbed(6)
    # A mask that spills over onto the box in front: inside it, only a placed box explains the nearer surface.
    spilled = Target(
        target.observation,
        type(target.instance)(0, 1, target.observation.object_mask, np.zeros((0, 3)), (), T_TORUS),
        target.model,
    )
    neighbour = Placed(5, box(), T_BOX)
    for pixels in MODES:
        settings = msgspec.convert({"pixels": pixels, "simplify_mm": 0}, ScoreSettings)
        verifier = make(pixels=pixels)
        alone, among = verifier.score(spilled, Ts), verifier.score(spilled, Ts, [neighbour])
        for i, T in enumerate(Ts):
            expected = reference(spilled, T, settings, [neighbour])
            assert among.score[i] == pytest.approx(expected["score"], abs=3e-4), pixels
            assert np.abs(among.counts[i] - expected["counts"]).max() <= 2, pixels
        hidden = 3
        assert among.counts[0, hidden] > alone.counts[0, hidden] + 100, pixels
        if pixels == "classes":
            assert among.score[0] > alone.score[0] + 0.01, pixels
        else:
            assert np.array_equal(among.score, alone.score), pixels


def test_an_object_does_not_hide_itself(make: MakeVerifier) -> None:
    target, Ts = target_of(), disturbed(3)
    verifier = make()
    itself = Placed(target.instance.instance_id, target.model, T_TORUS)
    assert np.array_equal(verifier.score(target, Ts, [itself]).counts, verifier.score(target, Ts).counts)


def test_maps_are_the_score_pixel_by_pixel(make: MakeVerifier) -> None:
    target, Ts = target_of(), disturbed(5)
    own = target.instance.mask & (target.observation.depth_m > 0)
    for pixels in MODES:
        verifier = make(pixels=pixels)
        scores = verifier.score(target, Ts)
        for i, T in enumerate(Ts):
            maps = verifier.maps(target, T)
            assert maps.counted.sum() == scores.n_pixels[i], pixels
            assert maps.f_d[maps.counted].mean() == pytest.approx(scores.depth_fit[i], abs=2e-6), pixels
            assert maps.f_n[maps.counted].mean() == pytest.approx(scores.normal_fit[i], abs=2e-6), pixels
            assert not maps.f_d[~maps.counted].any(), pixels
            assert not maps.f_n[~maps.counted].any(), pixels
            assert scores.counts[i].sum() == ((maps.rendered_m > 0) | own).sum(), pixels
            assert np.array_equal(np.bincount(maps.classes.ravel(), minlength=6)[1:], scores.counts[i]), pixels
            one_missing = (maps.rendered_m == 0) | (target.observation.depth_m == 0)
            assert np.array_equal(np.isnan(maps.depth_difference_m), one_missing), pixels
