"""A batch that is killed again and again: ``python -m bench.kills [N_KILLS]``, 20 by default; takes minutes.

Its tables must be those of a batch that never was.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from tests.batch.killed_batches import killed_until_done, n_done, without_times
from tests.light_frames import write_light_frames


def main(n_kills: int) -> int:
    """Kills batches until ``n_kills`` kills are together; 0 where every table was the same."""
    root = Path(tempfile.mkdtemp(prefix="verefine-kills-"))
    session, rng, total = write_light_frames(root, 4 * n_kills), random.Random(1), 0
    batch = [sys.executable, "-m", "verefine_viz.cli", "batch", str(session), "--workers", str(os.cpu_count()), "--out"]
    subprocess.run([*batch, str(root / "whole")], check=True)
    expected, k = without_times(root / "whole"), 0
    while total < n_kills:
        out = root / f"killed-{k}"
        killed = killed_until_done(
            [*batch, str(out)], partial(n_done, out), n_kills - total, rng, lambda text: print(text, flush=True)
        )
        same = without_times(out) == expected
        print(f"{killed.kills} kills, after {killed.frames_at_kill} frames: {'same' if same else 'OTHER'} tables")
        if not same:
            return 1
        total, k = total + killed.kills, k + 1
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 20))
