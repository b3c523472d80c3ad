"""Facts about this machine: processor, memory, disk space."""

from __future__ import annotations

import os
import platform
import resource
import shutil
import sys
import tempfile
from pathlib import Path

from verefine_viz.core.processor import processor_name

SHARE = 0.8
"""Share of the machine's memory that all workers together may take, unless a limit is given."""
CGROUP_LIMITS = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))


def machine() -> dict[str, str | int]:
    """A few facts about this computer; nothing that names its owner."""
    return {
        # Unlike platform.platform() these start no process.
        "system": f"{platform.system()}-{platform.release()}-{platform.machine()}",
        "python": platform.python_version(),
        "cpu": processor_name(),
        "cores": os.cpu_count() or 1,
    }


def resident_bytes(pid: int) -> int | None:
    """Memory that a process holds now [bytes]; None where the system does not say."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return None
    return pages * os.sysconf("SC_PAGE_SIZE")


def peak_bytes(pid: int) -> int | None:
    """Most memory that a process has held so far [bytes]; None where the system does not say."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    kilobytes = [line.split()[1] for line in lines if line.startswith("VmHWM:")]
    return int(kilobytes[0]) * 1024 if kilobytes else None


def own_peak_bytes() -> int:
    """Most memory that this process has held so far [bytes]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def machine_bytes() -> int:
    """Memory of the machine, or the limit of this process's container where that is lower [bytes]."""
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    for file in CGROUP_LIMITS:
        try:
            total = min(total, int(file.read_text(encoding="ascii")))
        except (OSError, ValueError):
            continue  # The file does not exist, or says "max".
    return total


def gigabytes(n_bytes: float) -> str:
    """A number of bytes as text: ``1.3 GB``."""
    return f"{n_bytes / 1e9:.1f} GB" if n_bytes >= 1e9 else f"{n_bytes / 1e6:.0f} MB"


def free_bytes(folder: Path) -> int:
    """Space on the disk of a folder that is free for this user."""
    return shutil.disk_usage(folder).free


def temporary_folder() -> Path:
    """Where temporary files go, also when the disk is full."""
    try:
        return Path(tempfile.gettempdir())
    except FileNotFoundError:  # It tried to write a file into each candidate, and every write failed.
        return Path("/tmp")
