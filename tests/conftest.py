"""Fixtures for all tests."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import platformdirs
import pytest
from hypothesis import HealthCheck, settings

from tests.nothing_skipped import NO_DATA, pytest_runtest_makereport

__all__ = ["pytest_runtest_makereport"]
pytest_plugins = ["tests.tiers", "tests.durations", "pytester"]

# Tests hide the user's cache, also from processes that they start: kernels are compiled once for all of them.
os.environ.setdefault("NUMBA_CACHE_DIR", str(platformdirs.user_cache_path("verefine-viz") / "kernels"))

# A busy machine is no failure; what is tested are laws, not times.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real frames beside the checkout."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(NO_DATA)
    return folder


def pytest_configure() -> None:
    """Ctrl-C and a closed terminal are tested: who starts the tests in the background or by ``nohup`` has them ignored,
    which children would inherit.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
