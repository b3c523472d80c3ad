from __future__ import annotations

from pathlib import Path

import pytest

from tests.batch import fragile
from tests.cli.bad_input import BadInput
from tests.scenes.bop_folder import Made, make
from verefine_viz.batch import worker_pool as pool


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make(tmp_path_factory.mktemp("data"))


@pytest.fixture
def bad_input(
    tmp_path: Path, made: Made, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> BadInput:
    # Bad input must be refused before the first frame is solved; a real worker would only cost time.
    monkeypatch.setattr(pool, "work", fragile.work)
    return BadInput(tmp_path, made, capsys)
