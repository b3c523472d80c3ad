"""How long each test file takes: ``make durations`` notes it, and every run begins with the files that take longest.

A file is run by one process, so that one which takes long and comes last would leave the other process idle.
"""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path

import pytest

DURATIONS = Path(__file__).parent / "durations.json"
"""A line a file: seconds of set-up, of the tests themselves and of tear-down, and how many tests there are."""
OPTION = "--write-durations"
PHASES = ("setup", "call", "teardown")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(OPTION, action="store_true", help=f"note how long each file took in {DURATIONS.name}")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption(OPTION) and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Writer(DURATIONS), "durations-writer")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts the files that take longest first; what is unknown comes before them."""
    known = read(DURATIONS)
    items.sort(key=lambda item: -sum(known.get(item.nodeid.partition("::")[0], [float("inf")])[: len(PHASES)]))


def read(path: Path) -> dict[str, list[float]]:
    """The durations by file, named from the root of the repository; none where they were never written."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


class Writer:
    """Sums what each file takes; at the end replaces the lines of the files that ran, and drops those that are gone."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._ran: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0, 0.0, 0])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        line = self._ran[report.nodeid.partition("::")[0]]
        line[PHASES.index(report.when or "call")] += report.duration
        line[-1] += report.when == "setup"

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        lines = {**read(self._path), **self._ran}
        there = [name for name in sorted(lines) if (session.config.rootpath / name).exists()]
        text = [f"{json.dumps(name)}: {json.dumps([round(value, 1) for value in lines[name]])}" for name in there]
        self._path.write_text("{\n" + ",\n".join(text) + "\n}\n", encoding="utf-8")
