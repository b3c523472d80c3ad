"""Remedies in the gallery: their table, the answers that it opens, and the session that is written."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.made_runs import because
from tests.page.conftest import Posted
from tests.report.runs import row, write_run
from verefine_viz.batch.fix_command import FixRequest
from verefine_viz.batch.fix_files import write_fix
from verefine_viz.core.causes import Cause
from verefine_viz.core.errors import InputError
from verefine_viz.page import protocol as p
from verefine_viz.page.gallery import read_gallery
from verefine_viz.page.verbs import Debugger
from verefine_viz.run.session_file import load_session


def test_a_table_is_sent_with_its_answers_and_a_session_is_written(
    debugger: Debugger, posted: Posted, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="no batch is open"):
        debugger.apply(None, p.Fix())
    rows = [row(0, add_s_mm=40.0, findings=because(Cause.SIMULATION)), row(1), row(2)]
    write_run(tmp_path / "run", rows)
    request = FixRequest(folder=tmp_path / "run")
    runs = request.runs()
    (trial,) = request.trials(runs)
    names = trial.jobs["run"].session.scene.frames
    write_run(trial.jobs["run"].folder, [row(one.im_id) for one in rows if one.frame in names])
    write_fix(request.table((trial,), runs), request.target)

    debugger.gallery = read_gallery(tmp_path / "run")
    debugger.send_fix(debugger.known_fix(), None)
    message = posted.of("fix")[-1]
    (line,) = message["table"]["rows"]
    assert (message["running"], line["tried"], line["came_right"], line["broke"]) == (False, 1, 1, 0)
    answers = [message["table"]["answers"][k] for k in line["answers"]]
    assert [one["change"] for one in answers] == [1, 0]
    assert [rows[one["key"]].frame for one in answers] == [one["frame"] for one in answers]
    assert all(Path(one["recording"]).is_file() for one in answers)

    file = tmp_path / "mended.toml"
    debugger.apply(None, p.Fix(take=(line["remedy"],), write=str(file)))
    assert not load_session(file).physics.enabled
