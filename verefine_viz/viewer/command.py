"""What every command is, and the types of their fields."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

Changes = tuple[tuple[str, Any], ...]
"""Settings to change: (("method.exploration", 0.2), …)."""


@dataclass(frozen=True)
class Command:
    """Base of all commands."""

    latest_wins: ClassVar[bool] = False
    """A newer one of the same kind makes an older one that still waits pointless (sliders, dragging)."""
