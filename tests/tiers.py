"""Three tiers of tests: ``fast``, ``slow``, ``browser``; and ``data``, on real frames. Folder and fixtures decide.

Tests in tests/browser are ``browser``. A test that asks for the fixture ``processes`` or ``long_run``, itself or
through other fixtures, is ``slow``. All others are ``fast``, and one of them that starts a process or a server fails.
A test of any tier that asks for ``shared_data`` is ``data`` as well.
"""

from __future__ import annotations

import multiprocessing.util
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from verefine_viz.run import kernels_ahead

BROWSER = Path(__file__).parent / "browser"
MAKES_SLOW = {"processes", "long_run"}
PROCESS_EVENTS = {"subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.system"}


@pytest.fixture(scope="session")
def processes() -> None:
    """Who asks for it may start processes (CoACD is one), servers and the viewer's App."""


@pytest.fixture(scope="session")
def long_run() -> None:
    """Who asks for it may take its time: it solves whole frames, or runs a study or a batch."""


def pytest_configure(config: pytest.Config) -> None:
    for line in (
        "fast: starts nothing and is done soon",
        "slow: starts processes or servers, or takes its time",
        "browser: drives the page in headless Chromium",
        "data: uses real frames beside the checkout, and is skipped where there are none",
    ):
        config.addinivalue_line("markers", line)
    config.pluginmanager.register(Guard(), "tiers-guard")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        item.add_marker(tier(item))
        if "shared_data" in getattr(item, "fixturenames", ()):
            item.add_marker("data")


def tier(item: pytest.Item) -> str:
    """The tier that a test belongs to."""
    if BROWSER in item.path.parents:
        return "browser"
    return "slow" if MAKES_SLOW.intersection(getattr(item, "fixturenames", ())) else "fast"


class Guard:
    """Fails the fast test that starts a process or listens on a port.

    Set-up counts, so that a fixture of a module or a session is under guard in the first test that asks for it. The
    user's cache is hidden: whether CoACD has to start must not depend on the colliders that are there.
    """

    def __init__(self) -> None:
        self._is_on = False
        self._seen: list[str] = []
        self._cache = tempfile.TemporaryDirectory(prefix="verefine-fast-")
        sys.addaudithook(self._audit)  # It cannot be taken off again.

    def pytest_unconfigure(self) -> None:
        self._cache.cleanup()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            if tier(item) == "fast":
                patch.setenv("XDG_CACHE_HOME", self._cache.name)
                patch.setattr(kernels_ahead, "compile_ahead", lambda session: None)
            return (yield)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        with self._watching(item):
            return (yield)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        with self._watching(item):
            return (yield)

    @contextmanager
    def _watching(self, item: pytest.Item) -> Iterator[None]:
        if tier(item) != "fast":
            yield
            return
        self._seen.clear()
        with pytest.MonkeyPatch.context() as patch:  # Python reports no event when multiprocessing spawns.
            patch.setattr(multiprocessing.util, "spawnv_passfds", lambda *args: self._refuse("a process"))
            self._is_on = True
            try:
                yield
            finally:
                self._is_on = False
        if self._seen:  # The code under test let it pass, or it came from another thread.
            pytest.fail(self._seen[0], pytrace=False)

    def _audit(self, event: str, args: tuple[Any, ...]) -> None:
        if not self._is_on or (event == "subprocess.Popen" and "fc-list" in args[1]):  # matplotlib's, once per cache.
            return
        if event in PROCESS_EVENTS:
            self._refuse(f"a process ({' '.join(map(str, args[1]))})" if event == "subprocess.Popen" else "a process")
        elif event == "socket.bind" and isinstance(args[1], tuple):
            self._refuse(f"a server at {args[1]}")

    def _refuse(self, what: str) -> None:
        self._seen.append(
            f"a fast test starts {what}; expected none; ask for the fixture `processes`, which makes the test slow, or "
            "give physics a convex object or hulls if it is CoACD"
        )
        pytest.fail(self._seen[-1])
