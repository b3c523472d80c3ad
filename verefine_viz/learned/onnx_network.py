"""A trained network: an ONNX file with its model card inside, run by onnxruntime. Same file and input, same bits.

It runs on one thread, as another order of sums would change last digits. The file is named by its hash wherever a
run is recorded.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
import onnxruntime
from msgspec import Meta
from numpy.typing import NDArray

from verefine_viz.core.errors import ContentError, InputError
from verefine_viz.core.files import Numbers3, decoded_json, read_file, reading
from verefine_viz.core.number_kinds import Id
from verefine_viz.core.refiner_steps import TrainedRange

PACKAGED = Path(__file__).parent / "weights"
"""Weights that come with the program."""
CARD = "card"
"""The entry of the file's metadata that holds the model card."""
LARGEST_BYTES = 500_000_000
"""Largest file of weights; a larger file, named by mistake, might fill the memory."""
_ERRORS_ONLY = 3
_LOOPS = (b"\x22\x04Loop", b"\x22\x04Scan")
"""Loop nodes, which run others repeatedly, as their kind is written in an ONNX file: field 4, 4 letters."""


class ModelCard(msgspec.Struct, frozen=True):
    """Description of a network by its training, which also holds data, seed, command, losses and metrics."""

    network: str
    """Name of the network: ``depth_net``."""
    format: int
    """Format of inputs and outputs; a network of another format cannot be used."""
    trained_range: TrainedRange | None = None
    """Distance of its training starts from the ground truth; None where it is not stated."""
    command: str = ""
    """Which trained it."""
    n_classes: Annotated[int, Meta(ge=1, le=10_000)] = 1
    points: Annotated[int, Meta(ge=1, le=100_000)] | None = None
    classes: tuple[Id, ...] = ()
    """DenseFusion: the objects that it knows, the number of points that it takes, and the sizes of the objects."""
    extents_mm: tuple[Numbers3, ...] = ()


class OnnxNetwork:
    """A network that takes arrays and gives arrays of float32: one (N, …) and (N, M) where it is called.

    Args:
        path: the ONNX file.
        name: the network that it has to be.
        format: the format that it has to have.

    Raises:
        InputError: the file cannot be read, is no ONNX file, or holds another network.
    """

    def __init__(self, path: Path, name: str, format: int) -> None:
        content = read_weights(path)
        self.path, self.hash = path, hash_of(content)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = _ERRORS_ONLY
        how = f"verefine-viz train {_command(name)} writes one"
        with reading(path, "weights", LARGEST_BYTES):
            if any(loop in content for loop in _LOOPS):
                raise ContentError(f"a network with loops, which may never end; {how}")
            # Without a second try, of which it prints.
            self._session = onnxruntime.InferenceSession(
                content, options, providers=["CPUExecutionProvider"], enable_fallback=0
            )
            written = self._session.get_modelmeta().custom_metadata_map.get(CARD)
            if written is None:
                raise ContentError(f"a network without a model card, expected {name}, format {format}; {how}")
            card = decoded_json(written.encode(), ModelCard)
            if (card.network, card.format) != (name, format):
                raise ContentError(f"{card.network}, format {card.format}, expected {name}, format {format}; {how}")
        self.card = card
        self._inputs = [given.name for given in self._session.get_inputs()]

    def __call__(self, x: NDArray[np.float32]) -> NDArray[np.float64]:
        """The answers (N, M) to inputs (N, …); see :meth:`answers`."""
        (answers,) = self.answers(x)
        return answers

    def answers(self, *inputs: NDArray[Any]) -> tuple[NDArray[np.float64], ...]:
        """All outputs for inputs in their order.

        Raises:
            InputError: an answer is not finite, or the network takes other inputs.
        """
        try:
            results = self._session.run(None, dict(zip(self._inputs, inputs, strict=True)))
        except Exception:
            raise InputError(
                f"weights {self.path} cannot be used: the network takes other inputs than {self.card.network}"
            ) from None
        answers = tuple(np.asarray(result, dtype=np.float64) for result in results)
        if not all(np.isfinite(answer).all() for answer in answers):
            raise InputError(f"weights {self.path} give NaN or infinity; train them again, or use others")
        return answers


def _command(network: str) -> str:
    """Which ``verefine-viz train`` writes a network: DenseFusion's two are trained together."""
    return "densefusion" if network.startswith("densefusion") else network


def read_weights(path: Path) -> bytes:
    """All bytes of a file of weights.

    Raises:
        InputError: it cannot be read, or is far too large.
    """
    return read_file(path, "weights", LARGEST_BYTES)


def hash_of(content: bytes) -> str:
    """The first 16 hexadecimal digits of SHA-256: names weights in recordings and run.json."""
    return hashlib.sha256(content).hexdigest()[:16]
