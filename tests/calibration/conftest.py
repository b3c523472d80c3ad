from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _takes_its_time(long_run: None) -> None:
    """All of them solve or draw whole frames."""
