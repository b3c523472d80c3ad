"""Tracking on the page: a frame begins with the answers of the frames before, and a saved session states them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.scenes.test_pose_sequence import write_sequence
from tests.scenes.test_trace import pose
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger

pytestmark = pytest.mark.usefixtures("long_run")


def test_a_frame_begins_with_the_answer_of_the_last_however_it_is_reached(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "box", n=3)
    overrides = {"method": {"name": "rir", "track": True, "iterations": 2}, "physics": {"enabled": False}}
    session = open_session(folder, overrides)
    at_once, in_turn = (Debugger(session, None, Toolbox) for _ in range(2))
    at_once.carry_out([c.OpenFrame("0/3")])
    in_turn.carry_out([c.RunUntil("end"), c.OpenFrame("0/2"), c.RunUntil("end"), c.OpenFrame("0/3")])
    pools = [d.workspace.work.problem.instances[0].hypotheses for d in (at_once, in_turn)]
    for pool in pools:
        assert [h.tracked_from for h in pool] == ["0/2", ""]
        assert np.array_equal(pool[1].T_cam_obj, pose(x=0.004))
    assert pools[0][0].T_cam_obj.tobytes() == pools[1][0].T_cam_obj.tobytes()
    # Saved, it repeats the frame without solving those before, also with other settings.
    (stated,) = at_once.workspace.session.tracked
    assert (stated.frame, stated.answered_in) == ("0/3", "0/2")
    at_once.carry_out([c.Restart((("method.iterations", 1),))])
    assert at_once.workspace.session.tracked == (stated,)
    alone = Toolbox(at_once.workspace.session)
    alone.track.recall = lambda frame: pytest.fail(f"asked for {frame}")
    assert alone.problem("0/3").instances[0].hypotheses[0].T_cam_obj.tobytes() == pools[0][0].T_cam_obj.tobytes()
