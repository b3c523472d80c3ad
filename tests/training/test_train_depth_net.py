"""Training with torch: skipped where the extra is not installed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.nothing_skipped import NO_TORCH
from verefine_viz import cli
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import axis_angle, random_unit_vector, transform
from verefine_viz.learned.depth_crops import FORMAT, rotation_by
from verefine_viz.learned.onnx_network import OnnxNetwork

torch = pytest.importorskip("torch", reason=NO_TORCH)

from verefine_viz.networks.onnx_export import onnx_bytes  # noqa: E402
from verefine_viz.training import course, depth_net_samples, held_out, train_depth_net  # noqa: E402
from verefine_viz.training.depth_net_model import DepthNetModel, errors_left, loss_of, rotations  # noqa: E402
from verefine_viz.training.train_depth_net import PEAK_RATE, Trained, learning_rate, train  # noqa: E402

pytestmark = pytest.mark.usefixtures("long_run")
BATCH = 8


@pytest.fixture(autouse=True)
def _few_views(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(depth_net_samples, "VIEWS_HELD", 12)
    monkeypatch.setattr(held_out, "N_VIEWS", 3)


def trained(folder: Path, n_steps: int, checkpoint: str = "c") -> Trained:
    return train(0, n_steps, 0.0, folder / checkpoint, lambda progress: None, BATCH)


def weights(model: object) -> list[bytes]:
    return [v.numpy().tobytes() for v in model.state_dict().values()]  # type: ignore[attr-defined]


def test_rotations_are_those_of_the_crops() -> None:
    vectors = np.random.default_rng(0).normal(size=(20, 3))
    expected = np.stack([rotation_by(v) for v in vectors])
    np.testing.assert_allclose(rotations(torch.from_numpy(vectors).float()), expected, atol=1e-5)


def test_the_right_answer_leaves_no_error_and_nothing_else_scores_better() -> None:
    rng = np.random.default_rng(1)
    points = torch.from_numpy(rng.normal(size=(5, 32, 3))).float()
    answers = torch.from_numpy(rng.normal(size=(5, 7)) * 0.3).float()
    wanted = points @ rotations(answers[:, :3]).transpose(1, 2) + answers[:, None, 3:6]
    assert errors_left(answers, points, wanted).max() < 1e-4
    nothing = torch.zeros(5, 7)
    assert loss_of(nothing, points, wanted)[0] > loss_of(answers, points, wanted)[0]


def test_same_seed_same_weights_and_stopping_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(train_depth_net, "REPORTED_EVERY", 2)
    monkeypatch.setattr(course, "SAVED_EVERY_S", 0.0)
    whole = trained(tmp_path, 6, "whole")

    class Killed(Exception):
        pass

    def stop_at_4(progress: object) -> None:
        if progress.step == 4:  # type: ignore[attr-defined]
            raise Killed

    with pytest.raises(Killed):  # After step 3's checkpoint, before that of step 4.
        train(0, 6, 0.0, tmp_path / "stopped", stop_at_4, BATCH)
    resumed = trained(tmp_path, 6, "stopped")
    assert weights(resumed.model) == weights(whole.model)
    assert resumed.losses == whole.losses


def test_turns_are_learned_at_the_rate_of_the_training() -> None:
    """Poses that are only turned, again and again: a network whose head dies leaves them as they are."""
    rng = np.random.default_rng(2)
    views = depth_net_samples.held_out_views(12)
    poses = [v.T_cam_obj @ transform(axis_angle(random_unit_vector(rng), 0.6), np.zeros(3)) for v in views * 3]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(depth_net_samples, "start_near", lambda view, rng: poses.pop(0))
        batch = depth_net_samples.batch_of(views * 3, rng)
    crops, points, wanted = (torch.from_numpy(a) for a in (batch.crops, batch.points, batch.wanted))
    torch.manual_seed(0)
    model = DepthNetModel()
    optimizer = torch.optim.AdamW(model.parameters(), lr=PEAK_RATE)
    errors = []
    for _ in range(60):
        loss, error = loss_of(model(crops), points, wanted)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        errors.append(float(error))
    assert errors[-1] < 0.2 * errors[0]


def test_a_checkpoint_of_another_training_is_refused(tmp_path: Path) -> None:
    trained(tmp_path, 2)
    with pytest.raises(InputError, match="seed 0 and 2 steps"):
        train(1, 2, 0.0, tmp_path / "c", lambda progress: None, BATCH)
    (tmp_path / "c").write_bytes(b"not a checkpoint")
    with pytest.raises(InputError, match="cannot be read"):
        trained(tmp_path, 2)


def test_the_rate_rises_and_falls() -> None:
    rates = [learning_rate(k, 1000) for k in range(1000)]
    assert rates[0] < rates[199] > rates[999]
    assert rates[999] < 1e-5


def test_the_exported_network_answers_as_the_model(tmp_path: Path) -> None:
    model = DepthNetModel().eval()
    card = {"network": "depth_net", "format": FORMAT}
    x = torch.randn(5, 6, 40, 40)
    (tmp_path / "net.onnx").write_bytes(onnx_bytes(model, (x[:2],), ({0: torch.export.Dim("n")},), card))
    network = OnnxNetwork(tmp_path / "net.onnx", "depth_net", FORMAT)
    with torch.no_grad():
        np.testing.assert_allclose(network(x.numpy()), model(x), atol=1e-4)
    # A pool of poses gets the bits of each alone.
    assert np.array_equal(network(x.numpy()), np.concatenate([network(x[k : k + 1].numpy()) for k in range(5)]))


def test_the_command_writes_weights_with_a_card(tmp_path: Path) -> None:
    out = tmp_path / "mine" / "net.onnx"
    assert cli.main(["train", "depth_net", "--out", str(out), "--steps", "2", "--seed", "3"]) == 0
    card = json.loads(out.with_suffix(".json").read_text())
    assert card["command"] == "verefine-viz train depth_net --out net.onnx --steps 2 --seed 3"
    assert [row["start_deg"] for row in card["held_out"]] == [10, 20, 30, 45]
    assert card["trained_range"]["rotation_deg"] == 60
    assert OnnxNetwork(out, "depth_net", FORMAT).card.command == card["command"]
    assert sorted(p.name for p in out.parent.iterdir()) == ["net.json", "net.onnx"]
