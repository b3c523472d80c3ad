"""``verefine-viz train`` without torch."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from verefine_viz import cli


@pytest.mark.parametrize("network", ["depth_net", "densefusion"])
def test_without_torch_it_names_the_extra(
    network: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.startswith(("verefine_viz.training", "verefine_viz.networks"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    assert cli.main(["train", network, "--out", str(tmp_path / "net.onnx")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "'verefine-viz[torch]'" in line
