"""Step through 6D pose verification and physics-guided refinement, and see why an estimate won."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.1.0"

# Open3D reads this variable when it is imported; in a notebook it would print a banner and start a web server.
os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")

_HOMES = {
    "VerefineError": "core.errors",
    **dict.fromkeys(("Frame", "OpenedFrame", "open_dataset", "open_frame"), "library.frame_to_solve"),
    **dict.fromkeys(("estimator", "refiner", "simulator", "verifier"), "library.plugins"),
    **dict.fromkeys(("estimate", "evaluate", "refine", "score", "score_maps", "settle"), "library.single_calls"),
    **dict.fromkeys(("Run", "open_run", "solve", "step"), "library.solving"),
    **dict.fromkeys(("Batch", "batch", "open_batch", "report"), "library.batches"),
    "label": "library.labelling",
    "show": "page.notebook",
    "share": "page.share",
    "Trace": "trace",
}
"""The module of each name; it is imported when the name is first asked for, as some are heavy. Types: __init__.pyi."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})


class _Library(ModuleType):
    """This package. ``vv.batch`` and ``vv.report`` are calls; the packages of these names are there by import alone."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):  # Python sets imported modules.
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Library
