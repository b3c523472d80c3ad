"""Several objects judged together: one depth buffer, one score."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.rendering.conftest import MakeVerifier
from tests.rendering.witness import (
    CAMERA,
    T_BOX,
    T_TABLE,
    T_TORUS,
    away_from_silhouettes,
    box,
    cast,
    disturbed,
    shell,
    table,
    target_of,
    torus,
)
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Placed, Target
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.cpu_verifier import CpuVerifier

MODES = ["published", "observed", "classes"]
T_SHELL = transform(axis_angle([1, 0, 0], np.pi + 0.6), [-0.09, 0.03, 0.5])
FAR_ASIDE = transform(np.eye(3), [9.0, 0, 0.5])


def targets_of(seed: int = 0) -> tuple[Target, Target, Target]:
    """A torus partly behind a box, a bowl beside them, on a table; noise, holes, and masks that overlap a little."""
    rng = np.random.default_rng(seed)
    items = [(torus(), T_TORUS), (box(), T_BOX), (shell(), T_SHELL), (table(), T_TABLE)]
    depth, normals, labels = cast(items, CAMERA)
    depth = np.where(depth > 0, depth + rng.normal(0, 0.002, depth.shape), 0)
    normals[rng.random(depth.shape) < 0.05] = 0
    depth[rng.random(depth.shape) < 0.05] = 0
    masks = [(labels == k) | np.roll(labels == k, 2, axis=1) for k in range(3)]
    observation = Observation(CAMERA, depth, normals, None, np.any(masks, axis=0), None)
    instances = [Instance(4 + k, k, mask, np.zeros((0, 3)), ()) for k, mask in enumerate(masks)]
    a, b, c = (Target(observation, i, model) for i, (model, _) in zip(instances, items, strict=False))
    return a, b, c


def combinations(n: int, seed: int = 2, size: float = 0.4) -> np.ndarray:
    """Poses (n, 3, 4, 4) around where torus, box and bowl are; the first is where they are."""
    rng = np.random.default_rng(seed)
    out = np.tile(np.stack([T_TORUS, T_BOX, T_SHELL]), (n, 1, 1, 1))
    for i, k in itertools.product(range(1, n), range(3)):
        out[i, k] @= transform(axis_angle(rng.normal(size=3), rng.uniform(0, size)), rng.normal(size=3) * 0.04 * size)
    return out


def plainly(
    targets: Sequence[Target], Ts: np.ndarray, settings: ScoreSettings, placed: Sequence[Placed], whole_frame: bool
) -> dict[str, Any]:
    """Score and classes of one combination, by ray casting and plain numpy from docs/methods.md 1.7 and 1.9."""
    observation = targets[0].observation
    models = [(t.model, T) for t, T in zip(targets, Ts, strict=True)]
    r, n_r, front = cast(models, CAMERA)
    q = cast([(p.model, p.T_cam_obj) for p in placed], CAMERA)[0] if placed else np.zeros_like(r)
    d, n_d = observation.depth_m.astype(float), observation.normals_cam.astype(float)
    masks = np.stack([t.instance.mask for t in targets])
    any_mask, tau = masks.any(0), settings.tau_m
    own = np.take_along_axis(masks, np.maximum(front, 0)[None], 0)[0] & (front >= 0)

    f_d = np.maximum(0, 1 - np.abs(d - r) / tau)
    f_n = np.maximum(0, 1 - (1 - np.clip((n_d * n_r).sum(-1), 0, 1)) / settings.alpha)
    both, near = (d > 0) & (r > 0), np.abs(d - r) < tau
    explained = both & near & own
    by_other = both & ~explained & (d < r + tau) & (q > 0) & (q < r) & (np.abs(d - q) < tau)
    sees_through = both & (d >= r + tau)
    elsewhere = both & near & ~own & ~by_other
    behind = both & (d <= r - tau) & ~by_other
    classes = {
        "explained": explained,
        "missed": (any_mask & (d > 0) & (r == 0)) | (behind & any_mask),
        "protruding": sees_through | elsewhere,
        "hidden": by_other | (behind & ~any_mask),
        "unknown": (r > 0) & (d == 0),
    }
    if settings.pixels != "published":
        f_n = np.where((n_d == 0).all(-1), f_d, f_n)
    if settings.pixels == "published":
        observed = np.where(observation.object_mask if whole_frame else any_mask, d, 0)
        fits, counted = both & (observed > 0), (r > 0) | (observed > 0)
    elif settings.pixels == "observed":
        fits, counted = both & any_mask, any_mask & (d > 0)
    else:
        fits, counted = explained, explained | classes["missed"] | classes["protruding"]
    score = 0.5 * (f_d[fits].sum() + f_n[fits].sum()) / counted.sum()
    if settings.pixels == "classes":
        score *= min(1, (1 - (classes["hidden"] | classes["unknown"]).sum() / (r > 0).sum()) / 0.1)
    return {
        "score": score,
        "n": counted.sum(),
        "counts": [c.sum() for c in classes.values()],
        "depth": r,
        "map": classes,
    }


def test_scores_and_classes_are_the_formula_s(make: MakeVerifier) -> None:
    targets, Ts = targets_of(), combinations(6)
    # All three; and the first two with the bowl as an object placed before.
    scenes = (3, []), (2, [Placed(6, shell(), T_SHELL)])
    for pixels, whole_frame, (m, placed) in itertools.product(MODES, (False, True), scenes):
        case = pixels, whole_frame, m
        settings = msgspec.convert({"pixels": pixels, "simplify_mm": 0}, ScoreSettings)
        got = make(pixels=pixels).score_scene(targets[:m], Ts[:, :m], placed, whole_frame)
        for i in range(len(Ts)):
            expected = plainly(targets[:m], Ts[i, :m], settings, placed, whole_frame)
            assert got.score[i] == pytest.approx(expected["score"], abs=3e-4), case
            assert np.abs(got.counts[i] - expected["counts"]).max() <= 4, case
            assert abs(got.n_pixels[i] - expected["n"]) <= 4, case
        assert got.score[0] > got.score[1:].max(), case


def test_depth_and_classes_are_those_of_ray_casting(make: MakeVerifier) -> None:
    targets, verifier = targets_of(), make()
    for Ts in combinations(4):
        maps = verifier.scene_maps(targets, Ts)
        expected = plainly(targets, Ts, ScoreSettings(simplify_mm=0), [], False)
        inner = away_from_silhouettes(expected["depth"])
        assert inner.sum() > 5000
        assert np.abs(maps.rendered_m - expected["depth"])[inner].max() < 1e-4
        labels = sum((k + 1) * c.astype(int) for k, c in enumerate(expected["map"].values()))
        assert (maps.classes != labels).sum() <= 6


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 10_000), size=st.floats(0, 2))
def test_one_object_is_a_scene_of_one(make: MakeVerifier, seed: int, size: float) -> None:
    target, Ts = target_of(), disturbed(4, seed, size)
    for pixels in MODES:
        verifier = make(pixels=pixels)
        for placed in ([], [Placed(5, box(), T_BOX)]):
            alone, scene = verifier.score(target, Ts, placed), verifier.score_scene([target], Ts[:, None], placed, True)
            for name in ("score", "depth_fit", "normal_fit", "n_pixels", "n_rendered", "counts"):
                assert getattr(alone, name).tobytes() == getattr(scene, name).tobytes(), pixels
        a, b = verifier.maps(target, Ts[1], placed), verifier.scene_maps([target], Ts[1:2], placed, True)
        for name in (
            "rendered_m",
            "rendered_normals",
            "depth_difference_m",
            "angle_rad",
            "f_d",
            "f_n",
            "counted",
            "classes",
        ):
            assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), pixels


def test_the_rest_of_the_frame_counts_for_published_pixels_only(make: MakeVerifier) -> None:
    targets, Ts = targets_of()[:2], combinations(4)[:, :2]
    for pixels in MODES:
        whole, part = (make(pixels=pixels).score_scene(targets, Ts, (), whole) for whole in (True, False))
        if pixels == "published":
            assert (whole.n_pixels > part.n_pixels + 500).all()
        else:
            assert whole.score.tobytes() == part.score.tobytes(), pixels


def test_the_order_of_the_targets_does_not_matter(make: MakeVerifier) -> None:
    targets, Ts = targets_of(), combinations(5)
    for pixels in MODES:
        verifier = make(pixels=pixels)
        first, maps = verifier.score_scene(targets, Ts), verifier.scene_maps(targets, Ts[1])
        for order in itertools.permutations(range(3)):
            again = verifier.score_scene([targets[k] for k in order], Ts[:, order])
            assert again.score.tobytes() == first.score.tobytes(), pixels
            assert np.array_equal(again.counts, first.counts), pixels
            classes = verifier.scene_maps([targets[k] for k in order], Ts[1][list(order)]).classes
            assert np.array_equal(classes, maps.classes), pixels


def test_an_object_out_of_sight_adds_its_mask_to_what_is_missed(make: MakeVerifier) -> None:
    torus_target, box_target, _ = targets_of()
    apart = box_target.instance.mask & ~torus_target.instance.mask
    clear = Instance(5, 1, apart, np.zeros((0, 3)), ())
    box_target = Target(box_target.observation, clear, box_target.model)
    for out_of_sight in (FAR_ASIDE, np.full((4, 4), np.nan), transform(np.eye(3), [0, 0, -1.0])):
        Ts = combinations(5, size=0.1)[:, :2].copy()
        Ts[:, 1] = out_of_sight
        verifier = make()
        alone, both = (
            verifier.score_scene(targets, Ts[:, : len(targets)])
            for targets in ((torus_target,), (torus_target, box_target))
        )
        added = both.counts - alone.counts
        n_box = int((apart & (box_target.observation.depth_m > 0)).sum())
        # What the torus hides of the box, or shows where the box is, was hidden and is now missed.
        assert np.array_equal(added[:, [0, 2, 4]], np.zeros((5, 3))), out_of_sight
        assert (added[:, 1] > n_box / 2).all(), out_of_sight
        assert np.array_equal(both.n_rendered, alone.n_rendered), out_of_sight
        total = [s.depth_fit * s.n_pixels for s in (alone, both)]
        assert total[0] == pytest.approx(total[1], rel=1e-9), out_of_sight


def test_an_object_in_the_place_of_another_explains_nothing_there(make: MakeVerifier) -> None:
    """Masks tell two instances apart even where depth cannot."""
    a, b, _ = targets_of()
    right, swapped = np.stack([T_TORUS, T_BOX]), np.stack([T_BOX, T_TORUS])
    verifier = make()
    twins = Target(a.observation, a.instance, box()), Target(b.observation, b.instance, torus())
    assert verifier.score_scene((a, b), right[None]).score[0] > 0.7
    wrong = verifier.score_scene(twins, swapped[None])
    assert wrong.counts[0, 0] < 0.1 * wrong.n_rendered[0]
    assert wrong.score[0] < 0.1


def test_what_a_nearer_object_of_the_scene_hides_is_not_judged(make: MakeVerifier) -> None:
    """With its mask spilled over the box, the torus alone is put behind what was seen there; with the box it is not."""
    a, b, _ = targets_of()
    spilled = Target(a.observation, Instance(4, 0, a.instance.mask | b.instance.mask, np.zeros((0, 3)), ()), a.model)
    verifier = make()
    alone = verifier.score_scene((spilled,), T_TORUS[None, None])[0]
    together = verifier.score_scene((spilled, b), np.stack([T_TORUS, T_BOX])[None])[0]
    assert together.counts[1] < 0.05 * alone.counts[1]
    assert together.score > alone.score + 0.1


def test_maps_are_the_score_pixel_by_pixel(make: MakeVerifier) -> None:
    targets, Ts = targets_of(), combinations(4)
    for pixels in MODES:
        verifier = make(pixels=pixels)
        for whole_frame in (False, True):
            scores = verifier.score_scene(targets[:2], Ts[:, :2], (), whole_frame)
            for i in range(len(Ts)):
                maps = verifier.scene_maps(targets[:2], Ts[i, :2], (), whole_frame)
                assert maps.counted.sum() == scores.n_pixels[i], pixels
                assert maps.f_d[maps.counted].mean() == pytest.approx(scores.depth_fit[i], abs=2e-6), pixels
                assert maps.f_n[maps.counted].mean() == pytest.approx(scores.normal_fit[i], abs=2e-6), pixels
                assert np.array_equal(np.bincount(maps.classes.ravel(), minlength=6)[1:], scores.counts[i]), pixels


def test_the_bits_do_not_depend_on_threads_or_history() -> None:
    targets, Ts = targets_of(), combinations(11)
    one, several = CpuVerifier(ScoreSettings(simplify_mm=0)), CpuVerifier(ScoreSettings(simplify_mm=0))
    one._n_threads, several._n_threads = 1, 5
    several.score_scene(targets[1:], Ts[:, 1:])
    assert one.score_scene(targets, Ts).score.tobytes() == several.score_scene(targets, Ts).score.tobytes()
    for n in range(1, 4):
        for some in itertools.combinations(range(3), n):
            several.score_scene([targets[k] for k in some], Ts[:2][:, some], (), n == 2)
    assert one.score_scene(targets, Ts).score.tobytes() == several.score_scene(targets, Ts).score.tobytes()


def test_what_is_no_scene_is_refused(make: MakeVerifier) -> None:
    verifier, targets, Ts = make(), targets_of(), combinations(2)
    assert len(verifier.score_scene(targets, Ts[:0])) == 0
    with pytest.raises(ShapeError, match="a scene of no targets cannot be scored"):
        verifier.score_scene((), Ts[:, :0])
    with pytest.raises(ShapeError, match=r"have shape \(2, 2, 4, 4\), expected n×3×4×4"):
        verifier.score_scene(targets, Ts[:, :2])
    with pytest.raises(ShapeError, match="the targets of a scene are of different frames, expected one frame"):
        verifier.score_scene((targets[0], targets_of()[1]), Ts[:, :2])
