"""Training DenseFusion with torch: skipped where the extra is not installed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree

from tests.nothing_skipped import NO_TORCH
from tests.scenes.bop_folder import make
from verefine_viz import cli
from verefine_viz.core.algorithm_settings import DenseFusionSettings
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply, axis_angle, random_unit_vector, rotation_of_quat_wxyz, transform
from verefine_viz.learned.densefusion_input import ObjectCrop
from verefine_viz.learned.densefusion_steps import DenseFusionPose
from verefine_viz.training import coloured_scenes as scenes_module
from verefine_viz.training import densefusion_samples
from verefine_viz.training.coloured_scenes import coloured_scenes
from verefine_viz.training.densefusion_samples import Sample

torch = pytest.importorskip("torch", reason=NO_TORCH)

from verefine_viz.networks.densefusion_networks import SLIM, PoseNet, PoseRefineNet  # noqa: E402
from verefine_viz.training import cached_samples, course, densefusion_command, train_densefusion  # noqa: E402
from verefine_viz.training.cached_samples import BATCH_SIZE, CachedSample, SampleBatch, cached, from_starts  # noqa: E402
from verefine_viz.training.densefusion_loss import distances, pose_loss, refine_loss, rotations  # noqa: E402
from verefine_viz.training.train_densefusion import TrainedDenseFusion, phase, refiner_loss  # noqa: E402

POINTS = 40


@pytest.fixture
def _few_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(densefusion_samples, "SCENES_HELD", 2)
    monkeypatch.setattr(cached_samples, "BATCHES_HELD", 3)
    monkeypatch.setattr(scenes_module, "IMAGE_PX", (240, 180))
    monkeypatch.setattr(scenes_module, "FOCAL_PX", (180.0, 300.0))
    monkeypatch.setattr(densefusion_command, "HELD_OUT_PICTURES", 1)
    monkeypatch.setattr(train_densefusion, "REPORTED_EVERY", 2)
    monkeypatch.setattr(course, "SAVED_EVERY_S", 0.0)


def tensors(rng: np.random.Generator, *shape: int) -> Any:
    return torch.from_numpy(rng.normal(size=shape)).float()


def test_rotations_are_those_of_the_geometry() -> None:
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(20, 4))
    expected = np.stack([rotation_of_quat_wxyz(q / np.linalg.norm(q)) for q in quats])
    np.testing.assert_allclose(rotations(torch.from_numpy(quats)), expected, atol=1e-9)


def some_objects(rng: np.random.Generator, n_poses: int) -> tuple[Any, ...]:
    """Rotations, places, points of models, where they belong, and which of three objects are symmetric."""
    Rs, ts = rotations(tensors(rng, 3, n_poses, 4)), tensors(rng, 3, n_poses, 3)
    return Rs, ts, tensors(rng, 3, 9, 3), tensors(rng, 3, 9, 3), torch.tensor([True, False, True])


def test_add_and_add_s_are_those_of_loops() -> None:
    Rs, ts, models, wanted, is_symmetric = some_objects(np.random.default_rng(1), 4)
    result = distances(Rs, ts, models, wanted, is_symmetric)
    assert result.shape == (3, 4)
    for k in range(3):
        for n in range(4):
            moved = [Rs[k, n].numpy() @ p + ts[k, n].numpy() for p in models[k].numpy()]
            each = [
                min(np.linalg.norm(m - w) for w in wanted[k].numpy()) if is_symmetric[k] else np.linalg.norm(m - own)
                for m, own in zip(moved, wanted[k].numpy(), strict=True)
            ]
            assert float(result[k, n]) == pytest.approx(float(np.mean(each)), rel=1e-5)


def test_the_pose_loss_is_the_papers() -> None:
    """1/N Σ (distance · c − w log c)."""
    rng = np.random.default_rng(2)
    quats, offsets, points = tensors(rng, 3, 5, 4), tensors(rng, 3, 5, 3), tensors(rng, 3, 5, 3)
    confidences = torch.sigmoid(tensors(rng, 3, 5))
    _, _, models, wanted, is_symmetric = some_objects(rng, 1)
    loss, best = pose_loss(quats, offsets, confidences, points, models, wanted, is_symmetric)
    apart = distances(rotations(quats), points + offsets, models, wanted, is_symmetric)
    each = [
        float(d) * float(c) - 0.015 * np.log(float(c))
        for d, c in zip(apart.flatten(), confidences.flatten(), strict=True)
    ]
    assert float(loss) == pytest.approx(np.mean(each), rel=1e-5)
    own = [float(apart[k, int(confidences[k].argmax())]) for k in range(3)]
    assert float(best) == pytest.approx(np.mean(own), rel=1e-5)


def test_the_step_that_leads_to_the_ground_truth_has_no_loss() -> None:
    rng = np.random.default_rng(3)
    quats, shifts, models = tensors(rng, 2, 4), tensors(rng, 2, 3), tensors(rng, 2, 30, 3)
    wanted = models @ rotations(quats).transpose(1, 2) + shifts[:, None]
    is_symmetric = torch.tensor([False, True])
    assert float(refine_loss(-quats, shifts, models, wanted, is_symmetric)) < 1e-5
    assert float(refine_loss(quats, shifts + 0.1, models, wanted, is_symmetric)) > 0.01


def some_sample(rng: np.random.Generator) -> Sample:
    """Of class 1, at a random pose."""
    crop = ObjectCrop(
        rng.random((1, 3, 40, 40)).astype(np.float32),
        rng.normal(size=(1, POINTS, 3)).astype(np.float32),
        rng.integers(0, 1600, POINTS),
        POINTS,
    )
    T = transform(axis_angle(random_unit_vector(rng), 2.0), rng.normal(size=3))
    model = rng.normal(size=(20, 3)).astype(np.float32)
    return Sample(crop, 1, model, apply(T, model).astype(np.float32), False, T.astype(np.float32))


def test_refining_starts_at_the_most_confident_pose_and_beside_the_ground_truth() -> None:
    """With a PoseRefineNet of no step, what is left is how far the starts are off, at each of both steps."""
    torch.manual_seed(0)
    rng = np.random.default_rng(4)
    pose, refine = PoseNet(2, SLIM).eval(), PoseRefineNet(2, SLIM)
    for name in ("r", "t"):
        last = refine.get_submodule(f"conv3_{name}")
        torch.nn.init.zeros_(last.weight)
        torch.nn.init.zeros_(last.bias)
    refine.get_submodule("conv3_r").bias.data[4] = 1.0  # The identity, of class 1.
    sample = some_sample(rng)
    image, points, chosen, index = train_densefusion.inputs(sample)
    with torch.no_grad():
        quats, offsets, confidences, _ = pose(image, points, chosen, index)
    k = int(confidences.argmax())
    R = rotation_of_quat_wxyz((quats[k] / quats[k].norm()).double().numpy())
    seen = cached(pose, sample)
    np.testing.assert_allclose(seen.T_pose_net[:3, :3], R, atol=1e-5)
    np.testing.assert_allclose(seen.T_pose_net[:3, 3], (points[0, k] + offsets[k]).numpy(), atol=1e-5)
    batch = from_starts([seen] * BATCH_SIZE, rng)
    left = (batch.models - batch.wanted).norm(dim=2).mean(dim=1).numpy()
    moved = sample.model @ R.T + seen.T_pose_net[:3, 3]
    from_pose_net = np.linalg.norm(moved - sample.wanted, axis=1)
    is_pose_nets = left > from_pose_net.min()
    assert 0.3 < is_pose_nets.mean() < 0.7
    # Beside the ground truth: a turn of at most 30 degrees, and a shift.
    largest = 2 * np.sin(np.deg2rad(15)) * np.linalg.norm(sample.model, axis=1).max() + cached_samples.AWAY_M
    assert left[~is_pose_nets].max() <= largest
    total, after = refiner_loss(refine, batch)
    assert float(after) == pytest.approx(left.mean(), rel=1e-4)
    assert float(total.detach()) == pytest.approx(2 * left.mean(), rel=1e-4)


def test_points_and_ground_truth_are_seen_from_the_same_start() -> None:
    """The points' distances from where the model belongs are those in the camera's frame."""
    rng = np.random.default_rng(5)
    sample = some_sample(rng)
    seen = CachedSample(sample, rng.normal(size=(32, POINTS)).astype(np.float32), sample.T_cam_obj)
    batch: SampleBatch = from_starts([seen] * 8, rng)
    every = np.linalg.norm(sample.crop.points[0][:, None] - sample.wanted[None], axis=2).ravel()
    for points, wanted in zip(batch.points.numpy(), batch.wanted.numpy(), strict=True):
        apart = np.linalg.norm(points[:, None] - wanted[None], axis=2).ravel()
        assert np.abs(apart[:, None] - every[None]).min(axis=1).max() < 1e-4


def test_a_batch_of_poses_is_each_of_them_alone() -> None:
    torch.manual_seed(1)
    rng = np.random.default_rng(6)
    pose, refine = PoseNet(3, SLIM).eval(), PoseRefineNet(3, SLIM).eval()
    points, colours, index = tensors(rng, 4, 10, 3), tensors(rng, 4, 32, 10), torch.tensor([2, 0, 1, 2])
    with torch.no_grad():
        together = [*pose.poses(points, colours, index), *refine.steps(points, colours, index)]
        for k in range(4):
            one = points[k : k + 1], colours[k : k + 1], index[k : k + 1]
            alone = [*pose.poses(*one), *refine.steps(*one)]
            for mine, own in zip(together, alone, strict=True):
                np.testing.assert_allclose(mine[k], own[0], atol=1e-5)


def test_parts_of_a_training_follow_each_other() -> None:
    phases = [phase(k, 100) for k in range(100)]
    assert [part for part, _, _ in phases] == [0] * 35 + [1] * 40 + [2] * 25
    for part, began_at in ((0, 0), (1, 35), (2, 75)):
        shares = [share for one, _, share in phases if one == part]
        assert {began for one, began, _ in phases if one == part} == {began_at}
        assert shares[0] == 0
        assert shares == sorted(shares)
        assert shares[-1] < 1


@pytest.mark.usefixtures("_few_pictures")
def test_a_pictures_poses_and_masks_are_those_of_its_depth(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points of the mask lie on the model at its pose."""
    monkeypatch.setattr(scenes_module, "_detected", lambda visible, rng: visible)
    made_up = coloured_scenes(None, "", 3)
    pictures = [made_up.picture(k) for k in range(3)]
    assert sum(map(len, pictures)) >= 3
    for seen in (o for picture in pictures for o in picture):
        cloud = seen.camera.back_project(seen.depth_m)[seen.mask & (seen.depth_m > 0)]
        T = seen.T_cam_obj
        away = KDTree(seen.model.points).query((cloud - T[:3, 3]) @ T[:3, :3])[0]
        assert np.quantile(away, 0.9) < 0.1 * seen.model.diameter_m
    again = coloured_scenes(None, "", 3).picture(1)
    assert [o.rgb.tobytes() for o in again] == [o.rgb.tobytes() for o in pictures[1]]


def trained(folder: Path, checkpoint: str, n_steps: int, report: Any = lambda now: None) -> TrainedDenseFusion:
    scenes = coloured_scenes(None, "", 0)
    return train_densefusion.train_densefusion(scenes, SLIM, POINTS, 0, n_steps, 0.0, folder / checkpoint, report, 2)


def weights(result: TrainedDenseFusion) -> list[bytes]:
    return [v.numpy().tobytes() for net in (result.pose, result.refine) for v in net.state_dict().values()]


@pytest.mark.usefixtures("long_run", "_few_pictures")
def test_same_seed_same_weights_and_stopping_changes_nothing(tmp_path: Path) -> None:
    """Stopped once in each of the three parts."""
    whole = trained(tmp_path, "whole", 12)

    class Killed(Exception):
        pass

    for last in (4, 8, 12):

        def stop(now: Any, last: int = last) -> None:
            if now.step == last:
                raise Killed

        with pytest.raises(Killed):  # Before the checkpoint of that step is written.
            trained(tmp_path, "stopped", 12, report=stop)
    resumed = trained(tmp_path, "stopped", 12)
    assert weights(resumed) == weights(whole)
    assert resumed.losses == whole.losses
    with pytest.raises(InputError, match="seed 0 and 12 steps"):
        trained(tmp_path, "stopped", n_steps=9)
    fresh = [v.numpy().tobytes() for v in PoseRefineNet(12, SLIM).state_dict().values()]
    assert weights(whole)[-len(fresh) :] != fresh


@pytest.mark.usefixtures("long_run", "_few_pictures")
def test_the_command_writes_both_networks_with_cards(tmp_path: Path) -> None:
    out = tmp_path / "mine" / "df.onnx"
    words = ["train", "densefusion", "--out", str(out), "--steps", "4", "--seed", "3", "--points", str(POINTS)]
    assert cli.main(words) == 0
    assert sorted(p.name for p in out.parent.iterdir()) == [
        "df.json", "df.onnx", "df_refine.json", "df_refine.onnx",
    ]  # fmt: skip
    card = json.loads(out.with_suffix(".json").read_text())
    assert card["command"] == f"verefine-viz train densefusion --out df.onnx --steps 4 --seed 3 --points {POINTS}"
    assert card["classes"] == [1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12, 15]
    assert len(card["extents_mm"]) == len(card["objects"]) == 12
    assert {"pose_net", "after_two_steps"} == card["measured"].keys()
    net = DenseFusionPose(out, DenseFusionSettings())
    assert net.classes.n_points == POINTS
    assert sum(p.stat().st_size for p in out.parent.glob("*.onnx")) < 8_000_000


@pytest.mark.usefixtures("_few_pictures")
def test_a_halved_picture_is_a_whole_one_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Same camera, same poses; colour and depth of a block of 2 × 2 pixels are one, and lie on the model."""
    monkeypatch.setattr(scenes_module, "_detected", lambda visible, rng: visible)
    whole, halved = (coloured_scenes(None, "", 3, is_halved).picture(0) for is_halved in (False, True))
    assert [o.model.obj_id for o in whole] == [o.model.obj_id for o in halved]
    for one, other in zip(whole, halved, strict=True):
        assert np.array_equal(one.T_cam_obj, other.T_cam_obj)
        assert np.array_equal(one.camera.K, other.camera.K)
        assert one.rgb.shape == other.rgb.shape
        for image in (other.rgb, other.depth_m):
            assert np.array_equal(image[::2, ::2], image[1::2, 1::2])
        assert (one.mask & other.mask).sum() > 0.7 * (one.mask | other.mask).sum()
        both = (one.depth_m > 0) & (other.depth_m > 0) & one.mask & other.mask
        assert np.median(np.abs(one.depth_m - other.depth_m)[both]) < 0.005


@pytest.mark.usefixtures("_few_pictures")
def test_the_annotated_frames_of_a_folder_are_learned_from(tmp_path: Path) -> None:
    dataset = make(tmp_path).root
    frames = coloured_scenes(dataset, "test", 0)
    pictures = [frames.picture(k) for k in range(4)]
    assert {o.model.obj_id for picture in pictures for o in picture} <= {model.obj_id for model in frames.models}
    samples = densefusion_samples.TrainingSamples(frames, 0, POINTS, 4).next()
    again = densefusion_samples.TrainingSamples(frames, 0, POINTS, 4).next()
    for sample, same in zip(samples, again, strict=True):
        assert sample.crop.points.shape == (1, POINTS, 3)
        assert np.array_equal(sample.crop.image, same.crop.image)
        assert np.array_equal(sample.wanted, same.wanted)


def test_models_without_colours_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no colours"):
        coloured_scenes(make(tmp_path).root, "", 0)


@pytest.mark.usefixtures("long_run")
def test_real_models_and_frames_are_learned_from(shared_data: Path) -> None:
    for dataset, split in ((shared_data / "lm", ""), (shared_data / "lm", "test"), (shared_data / "ycbv", "test")):
        scenes = coloured_scenes(dataset, split, 0)
        picture = next(filter(None, map(scenes.picture, range(9))))
        for seen in picture:
            cloud = seen.camera.back_project(seen.depth_m)[seen.mask & (seen.depth_m > 0)]
            away = KDTree(seen.model.points).query((cloud - seen.T_cam_obj[:3, 3]) @ seen.T_cam_obj[:3, :3])[0]
            assert np.median(away) < 0.15 * seen.model.diameter_m
