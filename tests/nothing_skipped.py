"""Where everything has to run, what would be skipped fails: ``make test`` and the CI set ``VEREFINE_REQUIRE_ALL=1``.

A plain ``pytest`` on a machine without Chromium, OpenGL or Vulkan skips what needs them and says so.
"""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

VARIABLE = "VEREFINE_REQUIRE_ALL"
NO_DATA = "no real frames beside the checkout (../shared/data)"
"""A good reason: they are too large to come with the program."""
NO_OTHER_BROWSER = "beside Chromium, the page is tried in what is there"
"""Another: Chromium is enough to work on the page."""
NO_TORCH = "training needs the extra torch"
"""The last one: it takes gigabytes, and only training needs it."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Iterator[None]:
    """Turns a skipped test into a failed one whose only line says what is missing."""
    report = yield
    if os.environ.get(VARIABLE) and report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2].removeprefix("Skipped: ")
        if not reason.endswith((NO_DATA, NO_TORCH, NO_OTHER_BROWSER)):
            report.outcome = "failed"
            report.longrepr = f"skipped, which {VARIABLE} forbids: {reason}"
    return report
