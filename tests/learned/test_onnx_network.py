import re
from pathlib import Path

import numpy as np
import pytest

from tests.learned.tiny_network import CARD, constant_network
from verefine_viz.core.errors import InputError
from verefine_viz.learned.depth_crops import CHANNELS, FORMAT, SIDE_PX
from verefine_viz.learned.onnx_network import OnnxNetwork, hash_of

ANSWER = np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6, -3.0])
CROPS = np.random.default_rng(0).normal(size=(3, len(CHANNELS), SIDE_PX, SIDE_PX)).astype(np.float32)


def opened(folder: Path, content: bytes) -> OnnxNetwork:
    path = folder / "net.onnx"
    path.write_bytes(content)
    return OnnxNetwork(path, "depth_net", FORMAT)


def test_it_answers_once_for_each_input_and_its_hash_is_that_of_the_file(tmp_path: Path) -> None:
    network = opened(tmp_path, constant_network(ANSWER))
    answers = network(CROPS)
    assert answers.dtype == np.float64
    np.testing.assert_allclose(answers, np.tile(ANSWER, (3, 1)), rtol=1e-6)
    content = constant_network(ANSWER)
    assert opened(tmp_path, content).hash == hash_of(content)
    assert hash_of(content) != hash_of(constant_network(-ANSWER))


def test_wrong_weights_are_one_clear_line(tmp_path: Path) -> None:
    for content, said in (
        (b"", "net.onnx: it is empty, fetch it again"),
        (
            b"PK\x03\x04 a checkpoint of torch",
            "net.onnx: it cannot be read as an ONNX network: it is damaged, or",
        ),
        (constant_network(ANSWER)[:-200], "it cannot be read as an ONNX network"),
        (constant_network(ANSWER).replace(b"\x22\x07Flatten", b"\x22\x04Loop"), "a network with loops"),
        (constant_network(ANSWER, None), "net.onnx: a network without a model card, expected depth_net, format 1"),
        (constant_network(ANSWER, {"network": 3}), "Expected `str`, got `int` (at $.network)"),
        (
            constant_network(ANSWER, CARD | {"network": "densefusion"}),
            "net.onnx: densefusion, format 1, expected depth_net, format 1",
        ),
        (constant_network(ANSWER, CARD | {"format": 2}), "net.onnx: depth_net, format 2, expected depth_net, format 1"),
    ):
        with pytest.raises(InputError, match=re.escape(said)) as raised:
            opened(tmp_path, content)
        assert str(tmp_path / "net.onnx") in str(raised.value), said
        assert "\n" not in str(raised.value), said


def test_missing_weights_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"weights .*no\.onnx.*no such file|weights .*no\.onnx.*not"):
        OnnxNetwork(tmp_path / "no.onnx", "depth_net", FORMAT)


def test_answers_that_are_no_numbers_and_other_shapes_are_refused(tmp_path: Path) -> None:
    for value in (np.nan, np.inf):
        network = opened(tmp_path, constant_network(np.full(7, value)))
        with pytest.raises(InputError, match="give NaN or infinity"):
            network(CROPS)
    network = opened(tmp_path, constant_network(ANSWER, channels=2))
    with pytest.raises(InputError, match="cannot be used") as raised:
        network(CROPS)
    assert "\n" not in str(raised.value)
