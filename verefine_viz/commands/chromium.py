"""The browser that looks at the page without a person."""

from __future__ import annotations

import shutil

NAMES = ("chromium", "chromium-browser", "google-chrome")


def find_chromium() -> str | None:
    """Its program; None where it is not installed."""
    return next(filter(None, map(shutil.which, NAMES)), None)
