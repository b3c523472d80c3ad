"""Writes a network of torch as ONNX, with its model card inside and beside it."""

# pyright: reportMissingImports=false
from __future__ import annotations

import io
import json
import logging
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import onnx
import torch
from torch import Tensor, nn

from verefine_viz.core.writing import atomic
from verefine_viz.learned.onnx_network import CARD

OPSET = 18
"""Version of ONNX's operators: one that every onnxruntime of pyproject.toml knows."""


def onnx_bytes(
    model: nn.Module,
    examples: tuple[Tensor, ...],
    sizes: Sequence[Mapping[int, Any] | None],
    card: Mapping[str, Any],
) -> bytes:
    """A network as an ONNX file's content.

    Args:
        model: the network.
        examples: example inputs, in order.
        sizes: for each, which of its axes may have another size (``torch.export.Dim``).
        card: its model card.
    """
    content = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Of the exporter's own parts.
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        program = torch.onnx.export(
            model.eval(), examples, dynamo=True, opset_version=OPSET, dynamic_shapes=tuple(sizes), verbose=False
        )
    assert program is not None
    program.save(content)
    exported = onnx.load_from_string(content.getvalue())
    for node in exported.graph.node:  # Source locations, which differ between computers.
        del node.metadata_props[:]
        node.doc_string = ""
    return with_card(exported.SerializeToString(), card)


def with_card(content: bytes, card: Mapping[str, Any]) -> bytes:
    """The content of an ONNX file with this model card instead of its own."""
    network = onnx.load_from_string(content)
    onnx.helper.set_model_props(network, {CARD: json.dumps(card)})
    return network.SerializeToString(deterministic=True)


def write_network(path: Path, content: bytes, card: Mapping[str, Any]) -> None:
    """Write the network to ``path`` and its card to the same name with ``.json``, each whole or not at all.

    Raises:
        InputError: a file cannot be written.
    """
    with atomic(path) as part:
        part.write_bytes(content)
    with atomic(path.with_suffix(".json")) as part:
        part.write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
