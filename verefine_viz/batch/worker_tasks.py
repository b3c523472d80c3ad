"""What workers of every kind are given: their task, and one thread to use. Imports nothing: see ``worker_process``."""

from __future__ import annotations

from typing import Literal

ONE_THREAD = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that are set to 1 before a worker loads numpy or numba."""

TaskName = Literal["solve", "explain", "estimate"]
"""What workers do with a frame: solve it; solve it and explain wrong answers; only make initial poses."""
