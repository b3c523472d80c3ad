"""ONNX files made by hand, byte by byte, so that tests of bad weights need no package that writes them.

The fields of ONNX's protocol buffers are those of https://github.com/onnx/onnx/blob/main/onnx/onnx.proto.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from verefine_viz.learned.depth_crops import ANSWERS, CHANNELS, FORMAT, SIDE_PX

CARD = {"network": "depth_net", "format": FORMAT}
FLOAT = 1


def constant_network(answer: np.ndarray, card: Mapping[str, Any] | None = CARD, channels: int = len(CHANNELS)) -> bytes:
    """A network that gives the same answer (7,) for every crop: 0 × mean of the crop + answer."""
    nodes = [
        _node("GlobalAveragePool", ["crops"], ["means"]),
        _node("Flatten", ["means"], ["flat"]),
        _node("MatMul", ["flat", "zeros"], ["nothing"]),
        _node("Add", ["nothing", "answer"], ["answers"]),
    ]
    constants = [_tensor("zeros", np.zeros((channels, ANSWERS))), _tensor("answer", np.asarray(answer)[None])]
    graph = b"".join(
        [
            *(_bytes(1, node) for node in nodes),
            _bytes(2, b"graph"),
            *(_bytes(5, constant) for constant in constants),
            _bytes(11, _value("crops", ["n", channels, SIDE_PX, SIDE_PX])),
            _bytes(12, _value("answers", ["n", ANSWERS])),
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


def _value(name: str, shape: list[str | int]) -> bytes:
    sizes = [_bytes(1, _bytes(2, n.encode()) if isinstance(n, str) else _int(1, n)) for n in shape]
    return _bytes(1, name.encode()) + _bytes(2, _bytes(1, _int(1, FLOAT) + _bytes(2, b"".join(sizes))))


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
