"""A trained network: an ONNX file with its model card inside, run by onnxruntime. Same file and input, same bits.

It runs on one thread, as sums in another order would have other last digits. The file is named by its hash wherever a
run is recorded.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from verefine_viz.core.errors import InputError, in_one_line
from verefine_viz.core.paths import open_input
from verefine_viz.core.refiner_steps import TrainedRange

PACKAGED = Path(__file__).parent / "weights"
"""Weights that come with the program."""
CARD = "card"
"""The entry of the file's metadata that holds the model card."""
LARGEST_BYTES = 500_000_000
"""No file of weights is larger; another that was named by mistake may fill the memory."""
_ERRORS_ONLY = 3


@dataclass(frozen=True)
class ModelCard:
    """What a network is, as its training wrote it down."""

    network: str
    """Its name: ``depth_net``."""
    format: int
    """Of what goes in and comes out; a network of another one cannot be used."""
    about: dict[str, Any]
    """Data, seed, command, losses, metrics, and the range that it was trained on."""

    @property
    def trained_range(self) -> TrainedRange | None:
        """How far its starts were from the ground truth; None where it does not say."""
        try:
            of = self.about["trained_range"]
            return TrainedRange(float(of["rotation_deg"]), float(of["shift_radii"]))
        except (KeyError, ValueError, TypeError):
            return None


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
        try:
            self._session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime has a class of its own for each of its codes.
            raise InputError(
                f"weights {path} are no ONNX file that onnxruntime reads ({_first_line(error)}); "
                f"verefine-viz train {_command(name)} writes one"
            ) from None
        card = _card_of(self._session)
        if card is None or (card.network, card.format) != (name, format):
            what = "a network without a model card" if card is None else f"{card.network}, format {card.format}"
            raise InputError(
                f"weights {path} hold {what}, expected {name}, format {format}; "
                f"verefine-viz train {_command(name)} writes it"
            )
        self.card = card
        self._inputs = [given.name for given in self._session.get_inputs()]

    def __call__(self, x: NDArray[np.float32]) -> NDArray[np.float64]:
        """The answers (N, M) to inputs (N, …); see :meth:`answers`."""
        (answers,) = self.answers(x)
        return answers

    def answers(self, *inputs: NDArray[Any]) -> tuple[NDArray[np.float64], ...]:
        """All that it answers to inputs in their order.

        Raises:
            InputError: an answer is not finite, or the network takes other inputs.
        """
        try:
            results = self._session.run(None, dict(zip(self._inputs, inputs, strict=True)))
        except Exception as error:
            raise InputError(f"weights {self.path} cannot be used: {_first_line(error)}") from None
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
    with open_input(path, "weights") as file:
        content = file.read(LARGEST_BYTES + 1)
    if len(content) > LARGEST_BYTES:
        raise InputError(f"weights {path} are larger than {LARGEST_BYTES // 1_000_000} MB, expected an ONNX file")
    return content


def hash_of(content: bytes) -> str:
    """The first 16 hexadecimal digits of SHA-256: names weights in recordings and run.json."""
    return hashlib.sha256(content).hexdigest()[:16]


def _card_of(session: onnxruntime.InferenceSession) -> ModelCard | None:
    try:
        card = json.loads(session.get_modelmeta().custom_metadata_map[CARD])
        return ModelCard(str(card["network"]), int(card["format"]), card)
    except (KeyError, ValueError, TypeError):
        return None


def _first_line(error: Exception) -> str:
    return in_one_line(str(error).splitlines()[0] if str(error) else type(error).__name__)[:200]
