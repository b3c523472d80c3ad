from __future__ import annotations

from pathlib import Path

import pytest

from tests.scenes.bop_folder import Made, make


@pytest.fixture
def made(tmp_path: Path) -> Made:
    """A data set in BOP layout with one frame of three boxes."""
    return make(tmp_path)
