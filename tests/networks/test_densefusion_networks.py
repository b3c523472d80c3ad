"""DenseFusion's networks against its formulas written down with plain functions, and official weights as files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.learned.test_densefusion_steps import coloured_target
from tests.nothing_skipped import NO_TORCH
from verefine_viz.core.algorithm_settings import DenseFusionSettings
from verefine_viz.core.errors import InputError
from verefine_viz.learned.densefusion_steps import POSE_NET, REFINE_NET, YCBV, DenseFusionPose
from verefine_viz.networks import densefusion_weights
from verefine_viz.networks.densefusion_weights import onnx_file, pose_network, refine_network

torch = pytest.importorskip("torch", reason=NO_TORCH)

from torch.nn import functional as F  # noqa: E402

from verefine_viz.networks.densefusion_networks import (  # noqa: E402
    OFFICIAL,
    SLIM,
    PoseNet,
    PoseRefineNet,
    Size,
    pose_net_example,
)
from verefine_viz.networks.official_weights import loaded  # noqa: E402
from verefine_viz.networks.onnx_export import onnx_bytes  # noqa: E402

State = dict[str, Any]


def seeded(model: Any, seed: int = 0) -> Any:
    """The model with other random weights than those it begins with: biases too, and no activation that dies out."""
    torch.manual_seed(seed)
    for value in model.state_dict().values():
        fan_in = value[0].numel() if value.dim() > 1 else 1
        value.copy_(torch.randn_like(value) * (1.6 / fan_in**0.5 if value.dim() > 1 else 0.2))
    return model.eval()


def colours_by_formula(s: State, image: Any) -> Any:
    """The colour branch: ResNet-18 without normalisation, pooling pyramid, three enlargements."""
    s = {key.removeprefix("cnn.model.module."): value for key, value in s.items()}
    x = F.max_pool2d(F.relu(F.conv2d(image, s["feats.conv1.weight"], None, 2, 3)), 3, 2, 1)
    for stage, stride, dilation in ((1, 1, 1), (2, 2, 1), (3, 1, 2), (4, 1, 4)):
        for block in (0, 1):
            w = f"feats.layer{stage}.{block}."
            step, wide = (stride, 1) if block == 0 else (1, dilation)
            y = F.relu(F.conv2d(x, s[f"{w}conv1.weight"], None, step, wide, wide))
            y = F.conv2d(y, s[f"{w}conv2.weight"], None, 1, wide, wide)
            if f"{w}downsample.0.weight" in s:
                x = F.conv2d(x, s[f"{w}downsample.0.weight"], None, step)
            x = F.relu(x + y)
    levels = []
    for k, n in enumerate((1, 2, 3, 6)):
        level = F.conv2d(F.adaptive_avg_pool2d(x, n), s[f"psp.stages.{k}.1.weight"])
        levels.append(F.interpolate(level, x.shape[2:], mode="bilinear", align_corners=False))
    x = F.relu(F.conv2d(torch.cat([*levels, x], 1), s["psp.bottleneck.weight"], s["psp.bottleneck.bias"]))
    for k in (1, 2, 3):
        x = F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=True)
        x = F.conv2d(x, s[f"up_{k}.conv.1.weight"], s[f"up_{k}.conv.1.bias"], padding=1)
        x = torch.where(x > 0, x, s[f"up_{k}.conv.2.weight"] * x)
    x = F.conv2d(x, s["final.0.weight"], s["final.0.bias"])
    return x - x.logsumexp(1, keepdim=True)


def layer(s: State, name: str, x: Any) -> Any:
    """A layer on columns (n_in, N)."""
    weight = s[f"{name}.weight"]
    return weight.reshape(weight.shape[:2]) @ x + s[f"{name}.bias"][:, None]


def pose_by_formula(
    s: State, image: Any, points: Any, chosen: Any, index: int, scale: float, halved: bool = False
) -> tuple[Any, ...]:
    if halved:  # Each pixel has the description of the nearest of the map.
        seen = image.unfold(2, 2, 2).unfold(3, 2, 2).mean((4, 5)) / scale
        small, (height, width) = colours_by_formula(s, seen)[0], image.shape[2:]
        rows, columns = chosen // width, chosen % width
        described = small[:, rows * small.shape[1] // height, columns * small.shape[2] // width]
    else:
        described = colours_by_formula(s, image / scale)[0].flatten(1)[:, chosen]
    x1, e1 = F.relu(layer(s, "feat.conv1", points.T)), F.relu(layer(s, "feat.e_conv1", described))
    x2, e2 = F.relu(layer(s, "feat.conv2", x1)), F.relu(layer(s, "feat.e_conv2", e1))
    second = torch.cat([x2, e2])
    whole = F.relu(layer(s, "feat.conv6", F.relu(layer(s, "feat.conv5", second)))).mean(1)
    features = torch.cat([x1, e1, second, whole[:, None].repeat(1, points.shape[0])])
    answers = []
    for head, n in (("r", 4), ("t", 3), ("c", 1)):
        x = features
        for k in (1, 2, 3):
            x = F.relu(layer(s, f"conv{k}_{head}", x))
        answers.append(layer(s, f"conv4_{head}", x)[n * index : n * (index + 1)].T)
    return answers[0], answers[1], torch.sigmoid(answers[2])[:, 0], described


def refine_by_formula(s: State, points: Any, described: Any, index: int) -> tuple[Any, Any]:
    x1, e1 = F.relu(layer(s, "feat.conv1", points.T)), F.relu(layer(s, "feat.e_conv1", described))
    x2, e2 = F.relu(layer(s, "feat.conv2", x1)), F.relu(layer(s, "feat.e_conv2", e1))
    whole = F.relu(layer(s, "feat.conv6", F.relu(layer(s, "feat.conv5", torch.cat([x1, e1, x2, e2]))))).mean(1)
    answers = []
    for head, n in (("r", 4), ("t", 3)):
        x = whole[:, None]
        for k in (1, 2):
            x = F.relu(layer(s, f"conv{k}_{head}", x))
        answers.append(layer(s, f"conv3_{head}", x)[n * index : n * (index + 1), 0])
    return answers[0], answers[1]


def random_input(height: int, width: int, n: int) -> tuple[Any, Any, Any]:
    torch.manual_seed(height + n)
    image = torch.rand(1, 3, height, width) * 255
    return image, torch.randn(1, n, 3) * 0.1, torch.randint(0, height * width, (n,))


@pytest.mark.parametrize(("data", "n_classes"), [("ycbv", 21), ("lm", 13)])
def test_layers_have_the_official_names_and_shapes(data: str, n_classes: int, shared_data: Path) -> None:
    official = json.loads((shared_data / "golden" / "densefusion_state_shapes.json").read_text())
    for name, model in (("posenet", PoseNet(n_classes)), ("refine", PoseRefineNet(n_classes))):
        ours = {key: list(value.shape) for key, value in model.state_dict().items()}
        assert ours == official[f"{name}_{data}"]


def test_the_slim_networks_are_small() -> None:
    parts = [sum(p.numel() for p in model(15, SLIM).parameters()) for model in (PoseNet, PoseRefineNet)]
    assert 4 * sum(parts) < 8_000_000


@pytest.mark.parametrize("size", [OFFICIAL, SLIM], ids=["official", "slim"])
@pytest.mark.parametrize(("height", "width", "n"), [(40, 80, 30), (120, 40, 7)])
def test_pose_net_computes_the_papers_formulas(size: Size, height: int, width: int, n: int) -> None:
    model = seeded(PoseNet(5, size))
    with torch.no_grad():
        model.state_dict()["conv4_c.weight"].mul_(1e-5)  # Confidences that are neither 0 nor 1.
    image, points, chosen = random_input(height, width, n)
    points = points * size.unit_m
    with torch.no_grad():
        answers = model(image, points, chosen, torch.tensor([3]))
        seen = (points[0] - points[0].mean(0) if size.is_centred else points[0]) / size.unit_m
        r, t, c, described = pose_by_formula(
            model.state_dict(), image, seen, chosen, 3, size.largest_colour, size.is_halved
        )
        expected = r, t * size.unit_m, c, described
    for ours, theirs in zip((*answers[:3], answers[3][0]), expected, strict=True):
        scale = float(theirs.abs().max())
        assert scale > 1e-4
        np.testing.assert_allclose(ours, theirs, atol=1e-4 * scale)


@pytest.mark.parametrize("size", [OFFICIAL, SLIM], ids=["official", "slim"])
def test_pose_refine_net_computes_the_papers_formulas(size: Size) -> None:
    model = seeded(PoseRefineNet(5, size))
    points, described = torch.randn(1, 40, 3), torch.randn(1, size.colour, 40)
    with torch.no_grad():
        answers = model(points, described, torch.tensor([2]))
        r, t = refine_by_formula(model.state_dict(), points[0] / size.unit_m, described[0], 2)
        expected = r, t * size.unit_m
    for ours, theirs in zip(answers, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-4 * float(theirs.abs().max()))


@pytest.fixture(scope="module")
def official_files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Saved states of the official shapes with random weights, as ``torch.save`` of the official training writes."""
    folder = tmp_path_factory.mktemp("official")
    files = folder / "pose_model.pth", folder / "pose_refine_model.pth"
    for file, model in zip(files, (seeded(PoseNet(21)), seeded(PoseRefineNet(21))), strict=True):
        torch.save(model.state_dict(), file)
    return files


@pytest.fixture
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(densefusion_weights, "_cache", lambda: tmp_path / "cache")


@pytest.mark.usefixtures("long_run", "_own_cache")
def test_official_weights_just_work_and_are_converted_once(
    official_files: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The converted networks answer as the formulas do, on a frame."""
    pose_file, refine_file = official_files
    settings = DenseFusionSettings(weights=str(pose_file), refiner_weights=str(refine_file))
    pose, steps = pose_network(settings), refine_network(settings)
    assert pose.classes == steps.classes == YCBV
    made = sorted((tmp_path / "cache").iterdir())
    assert [file.suffix for file in made] == [".onnx", ".onnx"]
    target = coloured_target(4)
    poses = pose.poses(target)
    assert poses is not None
    crop = pose.crop(target)
    assert crop is not None
    state = torch.load(pose_file, weights_only=True)
    with torch.no_grad():
        _, offsets, confidences, described = pose_by_formula(
            state, torch.from_numpy(crop.image), torch.from_numpy(crop.points[0]), torch.from_numpy(crop.chosen), 3, 1.0
        )
        # The cloud as seen from a pose, of the official model.
        T = poses.Ts_cam_obj[0]
        seen = (crop.points[0] - (T[:3, 3] - T[:3, :3] @ np.array(YCBV.shifts_mm[4]) / -1000)) @ T[:3, :3]
        quat, _ = refine_by_formula(
            torch.load(refine_file, weights_only=True), torch.from_numpy(seen).float(), described, 3
        )
    scale = float(described.abs().max())
    np.testing.assert_allclose(poses.colours.described[0], described, atol=1e-3 * scale)
    np.testing.assert_allclose(poses.confidences, confidences, atol=1e-3)
    refined = steps.refined(T, poses.colours, target.model, 1)
    unit = (quat / quat.norm()).double().numpy()
    turn = T[:3, :3].T @ refined[:3, :3]
    assert np.trace(turn) == pytest.approx(4 * unit[0] ** 2 - 1, abs=1e-2)
    moved = poses.Ts_cam_obj[:, :3, 3] + poses.Ts_cam_obj[:, :3, :3] @ np.array(YCBV.shifts_mm[4]) / 1000
    np.testing.assert_allclose(moved - crop.points[0], offsets, atol=1e-3 * float(offsets.abs().max()))
    # From now on without torch.
    monkeypatch.setitem(__import__("sys").modules, "verefine_viz.networks.official_weights", None)
    assert onnx_file(pose_file, POSE_NET) in made
    again = DenseFusionPose(onnx_file(pose_file, POSE_NET), settings).poses(target)
    assert again is not None
    assert np.array_equal(again.Ts_cam_obj, poses.Ts_cam_obj)


def test_names_may_come_wrapped_or_not(official_files: tuple[Path, Path], tmp_path: Path) -> None:
    state = torch.load(official_files[0], weights_only=True)
    for change in (lambda key: f"module.{key}", lambda key: key.replace("cnn.model.module.", "cnn.model.")):
        torch.save({change(key): value for key, value in state.items()}, tmp_path / "net.pth")
        model = loaded((tmp_path / "net.pth").read_bytes(), tmp_path / "net.pth", POSE_NET)
        assert torch.equal(model.state_dict()["conv4_c.bias"], state["conv4_c.bias"])
        key = "cnn.model.module.psp.bottleneck.weight"
        assert torch.equal(model.state_dict()[key], state[key])


def without(key: str) -> Any:
    return lambda state: {k: v for k, v in state.items() if k != key}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda state: [1, 2], "hold no state of a network"),
        (lambda state: {"layer": torch.zeros(3)}, "hold another network, expected PoseNet of DenseFusion"),
        (without("feat.conv5.bias"), "lack the layer feat.conv5.bias"),
        (
            lambda state: state | {"feat.conv1.bias": torch.zeros(9)},
            "feat.conv1.bias has the shape (9,), expected (64,)",
        ),
        (
            lambda state: state | {"feat.conv7.bias": torch.zeros(9)},
            "have the layer feat.conv7.bias, which DenseFusion",
        ),
    ],
)
def test_other_files_of_torch_are_one_line(
    official_files: tuple[Path, Path], tmp_path: Path, change: Any, said: str
) -> None:
    file = tmp_path / "net.pth"
    torch.save(change(torch.load(official_files[0], weights_only=True)), file)
    with pytest.raises(InputError) as raised:
        loaded(file.read_bytes(), file, POSE_NET)
    assert said in str(raised.value)
    assert str(file) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_files_that_are_swapped_or_no_files_of_torch_are_one_line(official_files: tuple[Path, Path]) -> None:
    pose_file, refine_file = official_files
    for file, name, holds in ((pose_file, REFINE_NET, "PoseNet"), (refine_file, POSE_NET, "PoseRefineNet")):
        with pytest.raises(InputError, match=f"hold {holds}, expected Pose.*Net of DenseFusion"):
            loaded(file.read_bytes(), file, name)
    with pytest.raises(InputError, match=r"net\.pth are no \.pth file of torch"):
        loaded(b"not of torch", Path("net.pth"), POSE_NET)


class Harmful:
    def __reduce__(self) -> Any:
        return (print, ("it ran",))


def test_nothing_in_a_file_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    torch.save({"layer": Harmful()}, tmp_path / "net.pth")
    with pytest.raises(InputError, match=r"are no \.pth file of torch"):
        loaded((tmp_path / "net.pth").read_bytes(), tmp_path / "net.pth", POSE_NET)
    assert "it ran" not in capsys.readouterr().out


@pytest.mark.usefixtures("long_run")
def test_the_exported_network_takes_crops_of_every_size_and_holds_no_paths(tmp_path: Path) -> None:
    model = seeded(PoseNet(3, SLIM))
    card = {"network": POSE_NET, "format": 1, "n_classes": 3, "classes": [5, 2, 1]}
    example, sizes = pose_net_example()
    content = onnx_bytes(model, example, sizes, card)
    assert b".py" not in content
    (tmp_path / "net.onnx").write_bytes(content)
    net = DenseFusionPose(tmp_path / "net.onnx", DenseFusionSettings())
    for height, width, n in ((40, 40, 3), (80, 200, 500), (160, 120, 77)):
        image, points, chosen = random_input(height, width, n)
        with torch.no_grad():
            expected = model(image, points, chosen, torch.tensor([1]))
        answers = net.network.answers(image.numpy(), points.numpy(), chosen.numpy(), np.array([1]))
        for ours, theirs in zip(answers, expected, strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-4 * max(1.0, float(theirs.abs().max())))
