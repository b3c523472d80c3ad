from __future__ import annotations

from pathlib import Path

import psutil
import pytest

from tests.fakes import box_problem
from tests.recording.runs import n_drawn, new_run, session
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import part_path
from verefine_viz.recording.rerun_viewer import free_port

pytestmark = pytest.mark.usefixtures("processes")


def test_live_viewers_are_served_on_loopback_only(tmp_path: Path) -> None:
    port = free_port()
    s, problem = session(iterations=2), box_problem(2)
    run = new_run(s, problem, (Recorder(tmp_path / "run.rrd", s, problem, live_port=port),))
    run.step()
    served = [c.laddr for c in psutil.Process().net_connections("tcp") if c.status == psutil.CONN_LISTEN]
    assert [a.ip for a in served if a.port == port] == ["127.0.0.1"]
    run.finish()
    assert len(read_recording(tmp_path / "run.rrd").entries) == 4


def test_a_live_recording_is_drawn_at_once(tmp_path: Path) -> None:
    s, problem = session(iterations=3, maps=False), box_problem(2)
    run = new_run(s, problem, (Recorder(tmp_path / "run.rrd", s, problem, live_port=free_port()),))
    for k in (1, 2, 3):
        run.step()
        assert n_drawn(part_path(tmp_path / "run.rrd")) == k
    run.close()
