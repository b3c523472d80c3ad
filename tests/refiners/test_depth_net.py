"""The learned refiner: what its weights are worth on made-up views, and that answers depend on the arguments only."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.learned.tiny_network import CARD, constant_network
from verefine_viz.core.algorithm_settings import DepthNetSettings, IcpSettings
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.geometry import angle_between, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Target
from verefine_viz.core.refiner_steps import TrainedRange, TrainedRefiner
from verefine_viz.core.settings import Session
from verefine_viz.learned.depth_crops import CHANNELS, FORMAT, SIDE_PX, crops_at, extent_of, moved_by
from verefine_viz.learned.onnx_network import PACKAGED, OnnxNetwork
from verefine_viz.refiners.depth_net import LARGEST_RAD, LARGEST_SHIFT, DepthNet, DepthNetIcp
from verefine_viz.refiners.registry import WEIGHTS, make_refiner
from verefine_viz.rendering.mesh import render_mesh
from verefine_viz.training.depth_net_samples import held_out_views
from verefine_viz.training.held_out import share_of_diameter, start_at
from verefine_viz.training.synthetic_views import SyntheticView

TARGET = box_problem().targets[0]
START = TARGET.instance.hypotheses[2].T_cam_obj
NET = DepthNet(DepthNetSettings(), 0.0)
NAMES = ("depth_net", "depth_net_icp")


def with_weights(folder: Path, answer: np.ndarray, iterations: int = 1) -> DepthNet:
    (folder / "net.onnx").write_bytes(constant_network(answer))
    return DepthNet(DepthNetSettings(weights=str(folder / "net.onnx"), iterations=iterations), 0.0)


def target_of(view: SyntheticView) -> Target:
    """The view as a frame with one instance."""
    rng, mesh = np.random.default_rng(0), view.shape.mesh
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = rng.choice(len(areas), 1000, p=areas / areas.sum())
    s, t = np.sort(rng.random((2, 1000)), axis=0)
    points = a[face] * s[:, None] + b[face] * (t - s)[:, None] + c[face] * (1 - t)[:, None]
    normals = mesh.face_normals[face]
    model = ObjectModel(
        1, "shape", mesh.vertices, mesh.faces, points, normals, 2 * view.shape.radius_m, np.eye(4)[None]
    )
    seen = view.camera.back_project(view.depth_m)[view.mask & (view.depth_m > 0)]
    nowhere = np.zeros((*view.camera.shape, 3), np.float32)
    observation = Observation(view.camera, view.depth_m, nowhere, None, view.mask, None)
    return Target(observation, Instance(0, 1, view.mask, seen[:1000], (), view.T_cam_obj), model)


@pytest.mark.usefixtures("long_run")
def test_the_weights_of_the_package_bring_shapes_that_they_have_not_seen_nearer() -> None:
    net_icp, views = DepthNetIcp(NET, IcpSettings()), held_out_views(40)
    for turn_deg, shift in ((20.0, 0.2), (40.0, 0.3)):
        rng = np.random.default_rng(1)
        before, net, both = [], [], []
        for view in views:
            T, target = start_at(view, turn_deg, shift, rng), target_of(view)
            before.append(share_of_diameter(view, T))
            net.append(share_of_diameter(view, NET.refine(target, T)))
            both.append(share_of_diameter(view, net_icp.refine(target, T)))
        assert np.median(net) < 0.9 * np.median(before), turn_deg
        assert np.median(both) < np.median(net), turn_deg
        assert np.mean(np.array(net) < before) > 0.6, turn_deg


def test_a_call_is_so_many_steps_of_the_network(tmp_path: Path) -> None:
    """Against the steps carried out one by one."""
    answer = np.array([0.05, -0.1, 0.2, 0.03, 0.02, -0.05, -3.0])
    target, extent = TARGET, extent_of(TARGET.model.vertices, TARGET.model.diameter_m)
    mesh, o = render_mesh(target.model.vertices, target.model.faces), target.observation
    expected = np.array(START)
    for _ in range(3):
        (R,) = crops_at(o.depth_m, target.instance.mask, o.camera, mesh, extent, expected[None]).Rs_crop_cam
        expected = moved_by(expected, answer[:6], R, extent)
    np.testing.assert_allclose(with_weights(tmp_path, answer, 3).refine(target, START), expected, atol=1e-6)


def test_a_step_is_never_longer_than_it_may_be_and_not_taken_within_the_error_that_it_leaves(tmp_path: Path) -> None:
    """Weights that were trained badly leave a rigid pose near the given one."""
    T = with_weights(tmp_path, np.array([50.0, 0, 0, 0, -80.0, 0, 0])).refine(TARGET, START)
    assert angle_between(T[:3, :3], START[:3, :3]) == pytest.approx(LARGEST_RAD)
    moved_m = np.linalg.norm(T[:3, 3] - START[:3, 3])
    assert moved_m == pytest.approx(LARGEST_SHIFT * TARGET.model.diameter_m / 2)
    assert np.allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
    # A step of 0.1 radii: taken where less than that is expected to be left, not where more is.
    for left, is_taken in ((0.05, True), (0.3, False)):
        T = with_weights(tmp_path, np.array([0, 0, 0, 0.1, 0, 0, np.log(left)])).refine(TARGET, START)
        assert (np.linalg.norm(T[:3, 3] - START[:3, 3]) > 1e-3) == is_taken


def test_answers_depend_on_the_arguments_only() -> None:
    for name in NAMES:
        used, fresh = (make_refiner(name, Session()) for _ in range(2))
        first = used.refine(TARGET, START)
        for h in TARGET.instance.hypotheses:
            used.refine(box_problem(seed=3).targets[0], h.T_cam_obj)
        assert np.array_equal(used.refine(TARGET, START), first), name
        assert np.array_equal(fresh.refine(TARGET, np.array(START)), first), name


def test_what_it_saw_can_be_asked_for() -> None:
    steps = NET.steps(TARGET, START)
    assert len(steps) == DepthNetSettings().iterations
    assert all(step.channels.shape == (1, len(CHANNELS), SIDE_PX, SIDE_PX) for step in steps)
    assert np.array_equal(steps[-1].Ts_cam_obj[0], NET.refine(TARGET, START))


def test_without_depth_in_the_mask_or_out_of_sight_the_pose_stays() -> None:
    instance = replace(TARGET.instance, mask=np.zeros_like(TARGET.instance.mask), points_cam=np.empty((0, 3)))
    nothing = replace(TARGET, instance=instance)
    for name in NAMES:
        assert np.array_equal(make_refiner(name, Session()).refine(nothing, START), START), name
    for place in ([0, 0, -0.6], [0, 0, 0.02], [90.0, 0, 1.0]):
        T = transform(np.eye(3), place)
        assert np.array_equal(NET.refine(TARGET, T), T)


def test_a_pose_that_is_no_number_is_refused() -> None:
    with pytest.raises(ShapeError, match="pose to refine holds NaN"):
        NET.refine(TARGET, np.full((4, 4), np.nan))


def test_weights_that_give_no_number_or_another_number_of_answers_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"weights .*net\.onnx give NaN or infinity"):
        with_weights(tmp_path, np.full(7, np.nan)).refine(TARGET, START)
    for n in (6, 8):
        with pytest.raises(InputError, match=rf"weights .*net\.onnx give 1 × {n} numbers for 1 crops, expected 1 × 7"):
            with_weights(tmp_path, np.zeros(n)).refine(TARGET, START)


def test_weights_that_are_cut_off_are_one_line(tmp_path: Path) -> None:
    whole = (PACKAGED / "depth_net.onnx").read_bytes()
    for share in (0.0, 0.3, 0.99):
        (tmp_path / "net.onnx").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(
            InputError,
            match=r"weights .*net\.onnx: ",
        ):
            DepthNet(DepthNetSettings(weights=str(tmp_path / "net.onnx")), 0.0)


def test_missing_weights_are_one_line(tmp_path: Path) -> None:
    session = Session(depth_net=DepthNetSettings(weights=str(tmp_path / "no.onnx")))
    for name, ask in itertools.product(NAMES, (make_refiner, lambda name, session: WEIGHTS[name](session))):
        with pytest.raises(InputError, match=re.escape(str(tmp_path / "no.onnx"))):
            ask(name, session)


def test_the_packages_weights_are_small_and_state_how_they_were_made() -> None:
    file = PACKAGED / "depth_net.onnx"
    assert file.stat().st_size < 4_000_000
    network = OnnxNetwork(file, "depth_net", FORMAT)
    assert network.card.command.startswith("verefine-viz train depth_net --out depth_net.onnx --steps ")
    assert WEIGHTS["depth_net"](Session()) == network.hash


def test_the_trained_range_is_that_of_the_model_card() -> None:
    for name in NAMES:
        refiner = make_refiner(name, Session())
        assert isinstance(refiner, TrainedRefiner), name
        assert refiner.trained_range == TrainedRange(rotation_deg=60.0, shift_radii=0.8), name


def test_a_card_without_a_range_has_none(tmp_path: Path) -> None:
    settings = DepthNetSettings(weights=str(tmp_path / "net.onnx"), iterations=1)
    (tmp_path / "net.onnx").write_bytes(constant_network(np.zeros(7), CARD))
    net = DepthNet(settings, 0.0)
    assert net.trained_range is None
    assert net.explain(TARGET, START)[0].trained_mm is None
    for given in (60, {"rotation_deg": "wide", "shift_radii": 1}):
        (tmp_path / "net.onnx").write_bytes(constant_network(np.zeros(7), CARD | {"trained_range": given}))
        with pytest.raises(InputError, match="trained_range"):
            DepthNet(settings, 0.0)
