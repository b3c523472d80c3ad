"""A batch that is killed at random moments leaves what one that never was leaves. bench/kills.py does it 20 times."""

from __future__ import annotations

import random
from functools import partial
from pathlib import Path

import pytest

from tests.batch.frames import batch_here, command
from tests.batch.killed_batches import killed_until_done, without_times
from tests.batch.outputs import done
from tests.light_frames import write_light_frames

pytestmark = pytest.mark.usefixtures("processes")

N_KILLS = 2


def _n_done(out: Path) -> int:
    return len(done(out))


def test_kills_at_random_moments_change_nothing(tmp_path: Path) -> None:
    session = write_light_frames(tmp_path, 15)
    assert batch_here(session, tmp_path / "whole", "--workers", 1).returncode == 0
    expected, n_kills, k = without_times(tmp_path / "whole"), 0, 0
    while n_kills < N_KILLS:  # on a fast machine a batch may be done before it is killed often enough
        out = tmp_path / f"killed-{k}"
        again = command("batch", session, "--out", out, "--workers", 2)
        n_kills += killed_until_done(again, partial(_n_done, out), N_KILLS - n_kills, random.Random(k)).kills
        assert without_times(out) == expected
        assert not list(out.rglob("*.part"))
        k += 1
