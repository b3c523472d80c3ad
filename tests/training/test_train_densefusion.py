"""Training DenseFusion with torch: skipped where the extra is not installed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree

from tests.nothing_skipped import NO_DATA, NO_TORCH
from tests.scenes.bop_folder import make
from verefine_viz import cli
from verefine_viz.core.algorithm_settings import DenseFusionSettings
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import rotation_of_quat_wxyz
from verefine_viz.learned.densefusion_input import ObjectCrop
from verefine_viz.learned.densefusion_steps import DenseFusionPose
from verefine_viz.training import coloured_scenes as scenes_module
from verefine_viz.training import densefusion_samples
from verefine_viz.training.coloured_scenes import coloured_scenes
from verefine_viz.training.densefusion_samples import Sample

torch = pytest.importorskip("torch", reason=NO_TORCH)

from verefine_viz.networks.densefusion_networks import SLIM, PoseNet, PoseRefineNet  # noqa: E402
from verefine_viz.training import course, densefusion_command, train_densefusion  # noqa: E402
from verefine_viz.training.densefusion_loss import distances, pose_loss, refine_loss, rotations  # noqa: E402
from verefine_viz.training.train_densefusion import TrainedDenseFusion, phase, refining_loss  # noqa: E402

POINTS = 40
DATA = Path(__file__).parents[3] / "shared" / "data"


@pytest.fixture
def _few_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(densefusion_samples, "SCENES_HELD", 2)
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


def test_add_and_add_s_are_those_of_loops() -> None:
    rng = np.random.default_rng(1)
    Rs, ts = rotations(tensors(rng, 3, 4)), tensors(rng, 3, 3)
    model, wanted = tensors(rng, 9, 3), tensors(rng, 9, 3)
    for is_symmetric in (False, True):
        result = distances(Rs, ts, model, wanted, is_symmetric)
        for k in range(3):
            moved = [Rs[k].numpy() @ p + ts[k].numpy() for p in model.numpy()]
            each = [
                min(np.linalg.norm(m - w) for w in wanted.numpy()) if is_symmetric else np.linalg.norm(m - own)
                for m, own in zip(moved, wanted.numpy(), strict=True)
            ]
            assert float(result[k]) == pytest.approx(float(np.mean(each)), rel=1e-5)


def test_the_pose_loss_is_the_papers() -> None:
    """1/N Σ (distance · c − w log c)."""
    rng = np.random.default_rng(2)
    quats, offsets, points = tensors(rng, 5, 4), tensors(rng, 5, 3), tensors(rng, 5, 3)
    confidences = torch.sigmoid(tensors(rng, 5))
    model, wanted = tensors(rng, 7, 3), tensors(rng, 7, 3)
    loss, best = pose_loss(quats, offsets, confidences, points, model, wanted, False)
    apart = distances(rotations(quats), points + offsets, model, wanted, False)
    expected = np.mean(
        [float(d) * float(c) - 0.015 * np.log(float(c)) for d, c in zip(apart, confidences, strict=True)]
    )
    assert float(loss) == pytest.approx(expected, rel=1e-5)
    assert float(best) == float(apart[int(confidences.argmax())])


def test_the_step_that_leads_to_the_ground_truth_has_no_loss() -> None:
    rng = np.random.default_rng(3)
    quat, shift, model = tensors(rng, 4), tensors(rng, 3), tensors(rng, 30, 3)
    wanted = model @ rotations(quat[None])[0].T + shift
    for is_symmetric in (False, True):
        assert float(refine_loss(-quat, shift, model, wanted, is_symmetric)) < 1e-5
        assert float(refine_loss(quat, shift + 0.1, model, wanted, is_symmetric)) > 0.01


def test_refining_goes_on_from_the_most_confident_pose() -> None:
    """With a PoseRefineNet of no step, what is left is the error of PoseNet's pose, at each of both steps."""
    torch.manual_seed(0)
    rng = np.random.default_rng(4)
    pose, refine = PoseNet(2, SLIM).eval(), PoseRefineNet(2, SLIM)
    for name in ("r", "t"):
        last = refine.get_submodule(f"conv3_{name}")
        torch.nn.init.zeros_(last.weight)
        torch.nn.init.zeros_(last.bias)
    refine.get_submodule("conv3_r").bias.data[4] = 1.0  # The identity, of class 1.
    crop = ObjectCrop(
        rng.random((1, 3, 40, 40)).astype(np.float32),
        rng.normal(size=(1, POINTS, 3)).astype(np.float32),
        rng.integers(0, 1600, POINTS),
        POINTS,
    )
    model = rng.normal(size=(20, 3)).astype(np.float32)
    sample = Sample(crop, 1, model, model + np.float32(0.5), False, np.eye(4, dtype=np.float32))
    image, points, chosen, index = train_densefusion.inputs(sample)
    with torch.no_grad():
        quats, offsets, confidences, _ = pose(image, points, chosen, index)
    k = int(confidences.argmax())
    R = rotation_of_quat_wxyz((quats[k] / quats[k].norm()).double().numpy())
    moved = model @ R.T + (points[0, k] + offsets[k]).numpy()
    expected = float(np.linalg.norm(moved - sample.wanted, axis=1).mean())
    total, left = refining_loss(pose, refine, sample)
    assert float(left) == pytest.approx(expected, rel=1e-4)
    assert float(total.detach()) == pytest.approx(2 * expected, rel=1e-4)


def test_three_quarters_of_the_steps_are_pose_nets() -> None:
    phases = [phase(k, 100) for k in range(100)]
    assert [is_refining for is_refining, _ in phases] == [False] * 75 + [True] * 25
    for part in (phases[:75], phases[75:]):
        shares = [share for _, share in part]
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


def trained(folder: Path, checkpoint: str, n_steps: int = 8, report: Any = lambda now: None) -> TrainedDenseFusion:
    scenes = coloured_scenes(None, "", 0)
    return train_densefusion.train_densefusion(scenes, SLIM, POINTS, 0, n_steps, 0.0, folder / checkpoint, report, 2)


def weights(result: TrainedDenseFusion) -> list[bytes]:
    return [v.numpy().tobytes() for net in (result.pose, result.refine) for v in net.state_dict().values()]


@pytest.mark.usefixtures("long_run", "_few_pictures")
def test_same_seed_same_weights_and_stopping_changes_nothing(tmp_path: Path) -> None:
    """Stopped once while PoseNet is trained and once while PoseRefineNet is."""
    whole = trained(tmp_path, "whole")

    class Killed(Exception):
        pass

    for last in (4, 8):

        def stop(now: Any, last: int = last) -> None:
            if now.step == last:
                raise Killed

        with pytest.raises(Killed):  # Before the checkpoint of that step is written.
            trained(tmp_path, "stopped", report=stop)
    resumed = trained(tmp_path, "stopped")
    assert weights(resumed) == weights(whole)
    assert resumed.losses == whole.losses
    with pytest.raises(InputError, match="is of a training with seed 0 and 8 steps"):
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
    assert {"pose_net", "after_two_steps"} == card["measured"].keys()
    net = DenseFusionPose(out, DenseFusionSettings())
    assert net.classes.n_points == POINTS
    assert sum(p.stat().st_size for p in out.parent.glob("*.onnx")) < 8_000_000


@pytest.mark.usefixtures("_few_pictures")
def test_the_annotated_frames_of_a_folder_are_learned_from(tmp_path: Path) -> None:
    dataset = make(tmp_path).root
    frames = coloured_scenes(dataset, "test", 0)
    pictures = [frames.picture(k) for k in range(4)]
    assert {o.model.obj_id for picture in pictures for o in picture} <= set(frames.obj_ids)
    samples = densefusion_samples.TrainingSamples(frames, 0, POINTS, 4).next()
    again = densefusion_samples.TrainingSamples(frames, 0, POINTS, 4).next()
    for sample, same in zip(samples, again, strict=True):
        assert sample.crop.points.shape == (1, POINTS, 3)
        assert np.array_equal(sample.crop.image, same.crop.image)
        assert np.array_equal(sample.wanted, same.wanted)


def test_models_without_colours_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no colours; DenseFusion learns from colour"):
        coloured_scenes(make(tmp_path).root, "", 0)


@pytest.mark.data
@pytest.mark.usefixtures("long_run")
def test_real_models_and_frames_are_learned_from() -> None:
    if not DATA.exists():
        pytest.skip(NO_DATA)
    for dataset, split in ((DATA / "lm", ""), (DATA / "lm", "test"), (DATA / "ycbv", "test")):
        scenes = coloured_scenes(dataset, split, 0)
        picture = next(filter(None, map(scenes.picture, range(9))))
        for seen in picture:
            cloud = seen.camera.back_project(seen.depth_m)[seen.mask & (seen.depth_m > 0)]
            away = KDTree(seen.model.points).query((cloud - seen.T_cam_obj[:3, 3]) @ seen.T_cam_obj[:3, :3])[0]
            assert np.median(away) < 0.15 * seen.model.diameter_m
