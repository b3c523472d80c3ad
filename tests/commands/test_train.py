"""``verefine-viz train``: what it refuses, and what it says without torch."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from verefine_viz import cli

REFUSED: list[tuple[list[str], str]] = [
    (["depth_net", "--out", "net.pth"], "--out is net.pth, expected a name that ends in .onnx"),
    (["depth_net", "--out", "net.onnx", "--minutes", "nan"], "--minutes is nan, expected more than 0"),
    (["depth_net", "--out", "net.onnx", "--steps", "0"], "--steps is 0, expected from 1"),
    (["depth_net", "--out", "net.onnx", "--dataset", "lm"], "--dataset is read by train densefusion only"),
    (["densefusion", "--out", "net.onnx", "--points", "1"], "--points is 1, expected from 2"),
    (["densefusion", "--out", "net.onnx", "--split", "train_pbr"], "--split is set without --dataset"),
]


def test_bad_words_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for words, said in REFUSED:
        assert cli.main(["train", *words]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("network", ["depth_net", "densefusion"])
def test_without_torch_it_names_the_extra(
    network: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.startswith(("verefine_viz.training", "verefine_viz.networks"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    assert cli.main(["train", network, "--out", str(tmp_path / "net.onnx")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("verefine-viz: training needs torch: pip install 'verefine-viz[torch]'")
