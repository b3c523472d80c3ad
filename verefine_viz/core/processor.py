"""The name of this machine's processor: what was measured on one says little about another."""

from __future__ import annotations

import platform
from pathlib import Path


def processor_name() -> str:
    """``AMD EPYC 9V74 80-Core Processor``; where the system does not say, its kind."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
