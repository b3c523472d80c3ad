"""Which view answers which want: functions ``(space, want, blobs) -> dict``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

ANSWERS: dict[type, Callable[..., dict[str, Any]]] = {}
