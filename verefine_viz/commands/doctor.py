"""``verefine-viz doctor``: what this machine has, and whether it computes right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Doctor:
    """Check this machine: versions, OpenGL, physics, browser, viewer, write access, and a short self-check."""

    def run(self, arguments: Sequence[str]) -> int:
        raise NotImplementedError
