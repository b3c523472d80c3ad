"""``verefine-viz fix`` on frames that are solved: a kill and a stop change nothing in its table, and the session that
it writes answers as the table said."""

from __future__ import annotations

import csv
import random
import subprocess
from functools import partial
from pathlib import Path
from time import sleep

import pytest

from tests.batch.frames import batch_here, command
from tests.batch.killed_batches import killed_until_done
from tests.light_frames import write_light_frames
from verefine_viz.batch.fix_command import FixRequest
from verefine_viz.batch.fix_files import CSV_FILE, FIX_FILE, FixTable
from verefine_viz.batch.fix_thread import FixState, FixThread
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.remedy_trials import jobs_of
from verefine_viz.batch.runs import Runs
from verefine_viz.core.files import read_json
from verefine_viz.run.run_header import failed_run

pytestmark = pytest.mark.usefixtures("processes")


def _table(folder: Path) -> list[dict[str, str]]:
    """fix.csv without times."""
    with (folder / CSV_FILE).open(newline="") as file:
        return [{k: v for k, v in line.items() if k != "seconds_added"} for line in csv.DictReader(file)]


def _n_done(out: Path) -> int:
    return len([*out.glob("*/runs/*.vfrun")])


def test_a_killed_fix_gives_the_same_table_and_the_written_session_the_same_answers(tmp_path: Path) -> None:
    session = write_light_frames(tmp_path, 6)
    text = session.read_text().replace("rotation_deg = 10.0", "rotation_deg = 60.0").replace('"sir"', '"rir"')
    text = text.replace("max_per_object = 2", "max_per_object = 1")
    session.write_text(text)
    run, whole, killed = tmp_path / "run", tmp_path / "whole", tmp_path / "killed"
    assert batch_here(session, run, "--workers", 1).returncode == 0
    wrong = [row for row in read_batch(run).rows if row.is_correct is not True]
    assert 0 < len(wrong) < 6
    fix = command("fix", run, "--take", "physics.enabled", "--workers", 1)
    taken = [*fix, "--out", whole, "--write", tmp_path / "mended.toml"]
    subprocess.run([str(word) for word in taken], check=True, capture_output=True)
    again = [*fix, "--out", str(killed)]
    killed_until_done(again, partial(_n_done, killed), 1, random.Random(1))
    assert _table(killed) == _table(whole)
    assert all(int(line["right_tried"]) >= min(int(line["tried"]), 6 - len(wrong)) for line in _table(whole))

    job = next(jobs_of(FixRequest(folder=run, out=killed).trials({"run": read_batch(run)})))
    frame = job.session.scene.frames[0]
    Runs(job.folder / "runs").save(job.session, failed_run(job.session, {}, frame, "no memory"))
    lost = [str(word) for word in again]
    assert subprocess.run(lost, capture_output=True, text=True).returncode == 1
    assert _table(killed) != _table(whole)
    subprocess.run([*lost, "--retry-failed"], check=True, capture_output=True)
    assert _table(killed) == _table(whole)

    stopped, states = FixRequest(folder=run, out=tmp_path / "stopped"), list[FixState]()
    beside = FixThread(stopped, 1, states.append).start()
    while not states or (states[-1].is_running and not states[-1].done):
        sleep(0.01)
    beside.stop()
    assert (beside.latest.is_running, beside.latest.fault, beside.latest.table) == (False, "stopped", None)
    beside = FixThread(stopped, 1, states.append).start()
    while beside.latest.is_running:
        sleep(0.1)
    assert beside.latest.done == beside.latest.total
    assert _table(tmp_path / "stopped") == _table(whole)

    mended = tmp_path / "mended"
    assert batch_here(tmp_path / "mended.toml", mended, "--workers", 1, "--no-diagnose").returncode == 0
    now = {(row.frame, row.instance_id): row.add_s_mm for row in read_batch(mended).rows}
    table = read_json(whole / FIX_FILE, FixTable)
    of_it = [one for one in table.answers if one.remedy == "physics.enabled = false"]
    assert of_it
    for one in of_it:
        assert now[one.frame, one.instance_id] == one.errors_mm[1]
