"""How much room there is on the disks that a batch writes to."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path


def free_bytes(folder: Path) -> int:
    """Room on the disk of a folder for this user."""
    return shutil.disk_usage(folder).free


def temporary_folder() -> Path:
    """Where temporary files go, also when there is no room left for them."""
    try:
        return Path(tempfile.gettempdir())
    except FileNotFoundError:  # It wrote a file in each place to be sure, and all of them refused.
        return Path("/tmp")
