"""Converts the official weights of DenseFusion, ``.pth`` files of torch, to ONNX. docs/methods.md 5.1."""

# pyright: reportMissingImports=false
from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from verefine_viz.core.errors import InputError
from verefine_viz.learned.densefusion_steps import FORMAT, POSE_NET, REFINE_NET
from verefine_viz.learned.onnx_network import hash_of
from verefine_viz.networks.densefusion_networks import (
    PoseNet,
    PoseRefineNet,
    pose_net_example,
    refine_net_example,
)
from verefine_viz.networks.onnx_export import onnx_bytes

LAST_LAYER = {POSE_NET: "conv4_r.weight", REFINE_NET: "conv3_r.weight"}
"""Its rows are four for each class."""
CALLED = {POSE_NET: "PoseNet", REFINE_NET: "PoseRefineNet"}


def onnx_of_pth(content: bytes, path: Path, name: str) -> bytes:
    """The network of a ``.pth`` file as ONNX.

    Args:
        content: the bytes of the file.
        path: of the file, for messages and the model card.
        name: of the network, ``POSE_NET`` or ``REFINE_NET``.

    Raises:
        InputError: the file is none of torch's, or holds another network.
    """
    model = loaded(content, path, name)
    card = {
        "network": name,
        "format": FORMAT,
        "n_classes": model.n_classes,
        "purpose": f"{CALLED[name]} of DenseFusion, weights of {path.name}",
        "weights": hash_of(content),
    }
    example, sizes = pose_net_example() if name == POSE_NET else refine_net_example(32)
    return onnx_bytes(model, example, sizes, card)


def loaded(content: bytes, path: Path, name: str) -> PoseNet | PoseRefineNet:
    """The network with the weights of a ``.pth`` file; raises as :func:`onnx_of_pth`."""
    try:
        # Numbers and arrays only: nothing that could run code is unpickled.
        state = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception:
        raise InputError(f"weights {path} are no .pth file of torch, or are damaged") from None
    if not isinstance(state, Mapping) or not all(isinstance(value, Tensor) for value in state.values()):
        raise InputError(f"weights {path} hold no state of a network (names and arrays)")
    state = {_official_name(str(key)): value for key, value in state.items()}
    last = state.get(LAST_LAYER[name])
    if last is None or (name == REFINE_NET and LAST_LAYER[POSE_NET] in state) or last.shape[0] % 4:
        others = [CALLED[other] for other, layer in LAST_LAYER.items() if layer in state]
        holds = others[0] if others else "another network"
        raise InputError(
            f"weights {path} hold {holds}, expected {CALLED[name]} of DenseFusion "
            "(densefusion.weights is PoseNet, densefusion.refiner_weights PoseRefineNet)"
        )
    make = PoseNet if name == POSE_NET else PoseRefineNet
    model = make(last.shape[0] // 4)
    _check_shapes(state, model.state_dict(), path)
    model.load_state_dict(state)
    return model.eval()


def _official_name(key: str) -> str:
    """A layer's name without ``DataParallel``, in which the network or its colour branch may have been wrapped."""
    key = key.removeprefix("module.")
    inner = key.removeprefix("cnn.model.")
    return key if inner == key or inner.startswith("module.") else f"cnn.model.module.{inner}"


def _check_shapes(state: Mapping[str, Tensor], expected: Mapping[str, Any], path: Path) -> None:
    for key, value in expected.items():
        if key not in state:
            raise InputError(f"weights {path} lack the layer {key}")
        if state[key].shape != value.shape:
            raise InputError(
                f"weights {path}: layer {key} has the shape {tuple(state[key].shape)}, expected {tuple(value.shape)}"
            )
    extra = [key for key in state if key not in expected]
    if extra:
        raise InputError(f"weights {path} have the layer {extra[0]}, which DenseFusion does not have")
