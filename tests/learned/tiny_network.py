"""ONNX files made by hand, byte by byte, so that tests of bad weights need no package that writes them.

The fields of ONNX's protocol buffers are those of https://github.com/onnx/onnx/blob/main/onnx/onnx.proto.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from verefine_viz.learned.depth_crops import CHANNELS, FORMAT, SIDE_PX

DENSEFUSION_COLOURS = 5
"""Numbers that describe a colour in the hand-made networks of DenseFusion."""
CARD = {"network": "depth_net", "format": FORMAT}
FLOAT, INT64 = 1, 7


def constant_network(answer: np.ndarray, card: Mapping[str, Any] | None = CARD, channels: int = len(CHANNELS)) -> bytes:
    """A network that gives the same answer, (7,) as it should be, for every crop: 0 × mean of the crop + answer."""
    nodes = [
        _node("GlobalAveragePool", ["crops"], ["means"]),
        _node("Flatten", ["means"], ["flat"]),
        _node("MatMul", ["flat", "zeros"], ["nothing"]),
        _node("Add", ["nothing", "answer"], ["answers"]),
    ]
    constants = [_tensor("zeros", np.zeros((channels, len(answer)))), _tensor("answer", np.asarray(answer)[None])]
    inputs, outputs = [_value("crops", ["n", channels, SIDE_PX, SIDE_PX])], [_value("answers", ["n", len(answer)])]
    return _model(nodes, constants, inputs, outputs, card)


def pose_network(quat: np.ndarray, offset: np.ndarray, towards: np.ndarray, n_classes: int, **about: Any) -> bytes:
    """A PoseNet: the same quaternion (4,) and offset (3,) for each point, the more confident the further it lies in a
    direction (3,), and colours that are the points' coordinates times 0.
    """
    nodes = [
        *_affine("points", "quat", "quats"),
        *_affine("points", "offset", "offsets"),
        *_affine("points", "towards", "logits"),
        _node("Sigmoid", ["logits"], ["confidences"]),
        *_affine("points", "colour", "colours"),
    ]
    constants = [
        *_affine_constants("quat", np.zeros((3, 4)), quat, [-1, 4]),
        *_affine_constants("offset", np.zeros((3, 3)), offset, [-1, 3]),
        *_affine_constants("towards", np.asarray(towards)[:, None], np.zeros(1), [-1]),
        *_affine_constants(
            "colour", np.zeros((3, DENSEFUSION_COLOURS)), np.zeros(DENSEFUSION_COLOURS), [1, DENSEFUSION_COLOURS, -1]
        ),
    ]
    inputs = [
        _value("image", [1, 3, "h", "w"]),
        _value("points", [1, "n", 3]),
        _value("chosen", ["n"], INT64),
        _value("index", [1], INT64),
    ]
    outputs = [
        _value("quats", ["n", 4]),
        _value("offsets", ["n", 3]),
        _value("confidences", ["n"]),
        _value("colours", [1, DENSEFUSION_COLOURS, "n"]),
    ]
    card = {"network": "densefusion_pose", "format": 1, "n_classes": n_classes, **about}
    return _model(nodes, constants, inputs, outputs, card)


def refine_network(quat: np.ndarray, follow: float, n_classes: int, **about: Any) -> bytes:
    """A PoseRefineNet: always the same quaternion (4,), and a shift of so much of the way to the points' middle."""
    nodes = [
        _node("Transpose", ["points"], ["turned"]),  # (3, N, 1)
        _node("Reshape", ["turned", "as_map"], ["map"]),
        _node("GlobalAveragePool", ["map"], ["middle"]),
        _node("Reshape", ["middle", "as_row"], ["middle_row"]),
        *_affine("middle_row", "quat", "quats"),
        *_affine("middle_row", "shift", "shifts"),
    ]
    constants = [
        _shape("as_map", [1, 3, -1]),
        _shape("as_row", [1, 3]),
        *_affine_constants("quat", np.zeros((3, 4)), quat, [4]),
        *_affine_constants("shift", follow * np.eye(3), np.zeros(3), [3]),
    ]
    inputs = [
        _value("points", [1, "n", 3]),
        _value("colours", [1, DENSEFUSION_COLOURS, "n"]),
        _value("index", [1], INT64),
    ]
    card = {"network": "densefusion_refine", "format": 1, "n_classes": n_classes, **about}
    return _model(nodes, constants, inputs, [_value("quats", [4]), _value("shifts", [3])], card)


def _affine(x: str, name: str, y: str) -> list[bytes]:
    """Nodes for y = x · matrix + bias in a shape; their constants are :func:`_affine_constants`."""
    return [
        _node("MatMul", [x, f"{name}_matrix"], [f"{name}_product"]),
        _node("Add", [f"{name}_product", f"{name}_bias"], [f"{name}_sum"]),
        _node("Reshape", [f"{name}_sum", f"{name}_shape"], [y]),
    ]


def _affine_constants(name: str, matrix: np.ndarray, bias: np.ndarray, shape: list[int]) -> list[bytes]:
    return [
        _tensor(f"{name}_matrix", matrix),
        _tensor(f"{name}_bias", np.asarray(bias)),
        _shape(f"{name}_shape", shape),
    ]


def _shape(name: str, shape: list[int]) -> bytes:
    numbers = np.array(shape, "<i8").tobytes()
    return _int(1, len(shape)) + _int(2, INT64) + _bytes(8, name.encode()) + _bytes(9, numbers)


def _model(
    nodes: list[bytes],
    constants: list[bytes],
    inputs: list[bytes],
    outputs: list[bytes],
    card: Mapping[str, Any] | None,
) -> bytes:
    graph = b"".join(
        [
            *(_bytes(1, node) for node in nodes),
            _bytes(2, b"graph"),
            *(_bytes(5, constant) for constant in constants),
            *(_bytes(11, value) for value in inputs),
            *(_bytes(12, value) for value in outputs),
        ]
    )
    model = _int(1, 8) + _bytes(7, graph) + _bytes(8, _int(2, 17))
    if card is not None:
        model += _bytes(14, _bytes(1, b"card") + _bytes(2, json.dumps(card).encode()))
    return model


def _node(kind: str, inputs: list[str], outputs: list[str]) -> bytes:
    names = [_bytes(1, n.encode()) for n in inputs] + [_bytes(2, n.encode()) for n in outputs]
    return b"".join(names) + _bytes(4, kind.encode())


def _tensor(name: str, values: np.ndarray) -> bytes:
    shape = b"".join(_int(1, n) for n in values.shape)
    return shape + _int(2, FLOAT) + _bytes(8, name.encode()) + _bytes(9, values.astype("<f4").tobytes())


def _value(name: str, shape: list[str | int], kind: int = FLOAT) -> bytes:
    sizes = [_bytes(1, _bytes(2, n.encode()) if isinstance(n, str) else _int(1, n)) for n in shape]
    return _bytes(1, name.encode()) + _bytes(2, _bytes(1, _int(1, kind) + _bytes(2, b"".join(sizes))))


def _varint(n: int) -> bytes:
    out = b""
    while n > 127:
        out += struct.pack("B", n & 127 | 128)
        n >>= 7
    return out + struct.pack("B", n)


def _int(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(content)) + content
