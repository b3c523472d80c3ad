"""``verefine-viz fix``: which answers a remedy is tried on, what is counted, which sessions have it; after kill or stop
its table is what it would have been, and the session that it writes answers as the table said.
"""

from __future__ import annotations

import csv
import random
import subprocess
from collections import Counter
from pathlib import Path
from time import sleep

import pytest
from msgspec import structs

from tests.batch.frames import batch_here, command
from tests.batch.killed_batches import killed_until_done
from tests.light_frames import write_light_frames
from tests.made_runs import answer, because
from tests.report.runs import row, write_run
from verefine_viz.batch.fix_command import FixRequest, write_sessions
from verefine_viz.batch.fix_files import CSV_FILE, EVERY_CAUSE, FIX_FILE, FixRow, FixTable, read_fix, write_fix
from verefine_viz.batch.fix_thread import FixState, FixThread
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.remedy_table import fits_better, net_gain, wilson
from verefine_viz.batch.remedy_trials import Trial, jobs_of, remedied, trials_of
from verefine_viz.batch.runs import Runs
from verefine_viz.core.causes import CAUSES, Cause
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.files import read_json
from verefine_viz.core.finding import Finding
from verefine_viz.core.remedies import COLOUR, MORE_EXPLORATION, NO_PHYSICS
from verefine_viz.core.settings import Session
from verefine_viz.run.record import Answer
from verefine_viz.run.run_header import failed_run
from verefine_viz.run.session_file import load_session, resolve

N_RIGHT = 12
BUDGET = Finding(Cause.BUDGET, "still on its way", {"times": 4.0})
PHYSICS, ITERATIONS = "physics.enabled = false", "method.iterations x4"


def _wrong(im_id: int, *findings: Finding) -> Answer:
    return row(im_id, add_s_mm=40.0, findings=findings)


ROWS = [
    _wrong(0, *because(Cause.SIMULATION)), _wrong(1, *because(Cause.PLANE)), _wrong(2, BUDGET),
    _wrong(3, *because(Cause.MASK)), _wrong(4), *(row(10 + k) for k in range(N_RIGHT)),
]  # fmt: skip
"""Four wrong ones by three causes, one that no setting mends, and right ones."""


def _trials(folder: Path, seed: int = 0, every: bool = False, together: tuple[str, ...] = ()) -> tuple[Trial, ...]:
    write_run(folder, ROWS)
    request = FixRequest(folder=folder, seed=seed, every=every, together=together)
    return request.trials(request.runs())


def _named(trials: tuple[Trial, ...], name: str) -> Trial:
    return next(trial for trial in trials if trial.name == name)


def test_a_remedy_is_tried_on_the_answers_of_its_causes_and_on_as_many_right_ones(tmp_path: Path) -> None:
    trials = _trials(tmp_path / "run")
    of_physics = _named(trials, PHYSICS)
    assert [one.row.im_id for one in of_physics.bad] == [0, 1]
    assert sum(not one.is_bad for one in of_physics.solved) == 2
    session = of_physics.jobs["run"].session
    assert {*session.scene.frames} == {one.row.frame for one in of_physics.solved}
    assert [one.row.im_id for one in _named(trials, ITERATIONS).bad] == [2]
    assert [t.name for t in _trials(tmp_path / "run")] == [t.name for t in trials]
    for trial in _trials(tmp_path / "run", every=True):
        assert [one.row.im_id for one in trial.bad] == [0, 1, 2, 3, 4]
    samples = {tuple(t.jobs["run"].session.scene.frames) for s in range(5) for t in _trials(tmp_path / "run", s)[:1]}
    assert len(samples) > 1
    # Its session has the remedy and nothing else.
    assert not session.physics.enabled
    base, physics = load_session(tmp_path / "run" / "session.toml"), structs.replace(session.physics, enabled=True)
    assert structs.replace(session, physics=physics, scene=base.scene, recording=base.recording) == base


def _solved(trials: tuple[Trial, ...], **changed: set[int]) -> None:
    """Writes the batches of all trials: these images come right, break or are lost, others stay as they are."""
    became = {
        "right": {"add_s_mm": 2.0},
        "wrong": {"add_s_mm": 40.0},
        "lost": {"status": "no_answer", "add_s_mm": None},
    }
    fields = {im_id: became[how] for how, images in changed.items() for im_id in images}
    for job in (job for trial in trials for job in trial.jobs.values()):
        write_run(
            job.folder,
            [structs.replace(r, **fields.get(r.im_id, {})) for r in ROWS if r.frame in job.session.scene.frames],
        )


def _table(folder: Path, every: bool = False) -> FixTable:
    request = FixRequest(folder=folder, every=every)
    runs = request.runs()
    return request.table(request.trials(runs), runs)


def test_the_table_counts_every_answer_once_and_its_best_remedy_is_first(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    trials = _trials(folder, every=True)
    _solved(trials, right={0, 1}, wrong={min(one.row.im_id for one in trials[0].solved if not one.is_bad)})
    table = _table(folder, every=True)
    for line in table.rows:
        answers = [a for a in table.answers if a.remedy == line.remedy]
        bad = [a for a in answers if a.was_bad and line.cause in (a.cause, EVERY_CAUSE)]
        assert line.tried == len(bad)
        assert line.came_right == sum(a.change == 1 for a in bad)
        assert (line.right_tried, line.broke, line.right_known) == (5, 1, N_RIGHT)
        assert line.net_gain == pytest.approx(line.came_right - N_RIGHT / 5)
        assert line.net_low < line.net_gain < line.net_high
    gains = [line.net_gain for line in table.rows]
    assert gains == sorted(gains, reverse=True)
    by_remedy = Counter(line.remedy for line in table.rows if line.cause == EVERY_CAUSE)
    assert {*by_remedy.values()} == {1}
    for remedy in by_remedy:
        lines = [line for line in table.rows if line.remedy == remedy]
        every = next(line for line in lines if line.cause == EVERY_CAUSE)
        assert every.tried == sum(line.tried for line in lines if line is not every) == 5
        assert every.came_right == sum(line.came_right for line in lines if line is not every) == 2


def test_a_right_answer_without_one_afterwards_counts_as_broken_and_the_files_hold_the_table(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    _solved(_trials(folder), lost={*range(10, 10 + N_RIGHT)})
    table = _table(folder)
    (line,) = [line for line in table.rows if line.remedy == ITERATIONS]
    assert (line.tried, line.came_right, line.right_tried, line.broke) == (1, 0, 1, 1)
    write_fix(table, folder / "fix")
    assert read_fix(folder) == table
    with (folder / "fix" / CSV_FILE).open(newline="") as file:
        lines = [*csv.DictReader(file)]
    assert [line["remedy"] for line in lines] == [one.remedy for one in table.rows]
    assert [*lines[0]] == [*FixRow.__struct_fields__]


def test_several_are_tried_together_and_written_as_they_were_tried(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    together = ("physics.enabled", ITERATIONS)
    trials = _trials(folder, together=together)
    trial = trials[-1]
    assert trial.name == f"{PHYSICS} + {ITERATIONS}"
    assert [one.row.im_id for one in trial.bad] == [0, 1, 2]
    runs = {"run": read_batch(folder)}
    (file,) = write_sessions(together, trials, runs, tmp_path / "mended.toml")
    written, tried = load_session(file), trial.jobs["run"].session
    assert (written.method, written.physics) == (tried.method, tried.physics)
    assert written.scene == runs["run"].session.scene
    assert file.read_text().startswith(f"# changed by fix: {PHYSICS} (was true), method.iterations = ")
    assert _trials(folder, together=(trial.name,))[-1].name == trial.name
    assert write_sessions((f"{ITERATIONS} + physics.enabled",), trials, runs, tmp_path / "same.toml")
    assert load_session(tmp_path / "same.toml") == written
    with pytest.raises(SettingsError, match=r"method\.name"):
        _trials(folder, together=("method.name",))


def test_where_causes_name_only_what_is_set_already_every_known_remedy_is_tried(tmp_path: Path) -> None:
    write_run(tmp_path, [_wrong(0, *because(Cause.AMBIGUOUS)), row(1)], {"score": {"colour_weight": 0.1}})
    runs = FixRequest(folder=tmp_path).runs()
    assert FixRequest(folder=tmp_path).trials(runs) == ()
    trials = FixRequest(folder=tmp_path, every=True).trials(runs)
    assert {PHYSICS, "method.iterations x2"} <= {trial.name for trial in trials}
    assert all(trial.name != COLOUR.name for trial in trials)


def test_each_run_of_a_folder_has_a_trial_and_a_session_of_its_own(tmp_path: Path) -> None:
    write_run(tmp_path / "a", [_wrong(0, *because(Cause.ARM_STARVED))], {"method": {"exploration": 0.1}})
    write_run(tmp_path / "b", [row(0), row(1)], {"method": {"exploration": 0.7}})
    write_run(tmp_path / "c", [row(0)], {"method": {"name": "pir"}})
    request = FixRequest(folder=tmp_path)
    runs = request.runs()
    trial = _named(request.trials(runs), "method.exploration x2")
    assert {run: job.session.method.exploration for run, job in trial.jobs.items()} == {"a": 0.2, "b": 1.4}
    files = write_sessions((trial.name,), request.trials(runs), runs, tmp_path / "mended.toml")
    assert [file.name for file in files] == ["mended-a.toml", "mended-b.toml"]  # c has no bonus


def test_every_remedy_is_a_setting_that_a_session_can_have() -> None:
    for remedy in (remedy for known in CAUSES.values() for remedy in known.remedies):
        method = "physim_mcts" if remedy.setting.startswith("mcts") else "rir"
        session = resolve(
            {
                "scene": {"source": "bop", "dataset": "data"}, "physics": {"collider": "hull"}, "preset": "published",
                "method": {"name": method, "refiner": "trimmed_icp"},
            }
        )  # fmt: skip
        remedy = remedy.for_finding({"factor": 1000.0})
        changed = remedied(session, [remedy])
        assert changed is not None, remedy.name
        assert remedied(changed, [remedy]) is None or remedy.to is None, remedy.name
    with pytest.raises(SettingsError):
        remedied(Session(), [COLOUR, COLOUR])
    still = structs.replace(Session(), physics=structs.replace(Session().physics, enabled=False))
    assert remedied(still, [NO_PHYSICS]) is None
    assert MORE_EXPLORATION.changes(Session()) == {"method.exploration": 2 * Session().method.exploration}


def test_without_ground_truth_physics_decides_before_the_score_and_the_score_before_how_much_is_undetermined() -> None:
    session = Session()
    was = answer(score=0.6, undetermined_mm=5.0, undetermined_deg=5.0)
    impossible = structs.replace(was, findings=because(Cause.IMPOSSIBLE))

    def better(before: Answer, after: Answer | None, other: Session = session) -> int:
        return fits_better(before, after, session, other)

    assert better(was, was) == better(was, structs.replace(was, score=0.61)) == 0
    assert better(impossible, structs.replace(was, score=0.5)) == 1
    assert better(was, structs.replace(impossible, score=0.9)) == -1
    assert better(was, structs.replace(was, score=0.7, undetermined_mm=20.0)) == 1
    assert better(was, structs.replace(was, undetermined_mm=20.0)) == -1
    assert better(was, structs.replace(was, n_alike=1)) == -1
    assert better(was, None) == better(was, structs.replace(was, status="no_answer")) == -1
    assert better(structs.replace(was, status="no_answer"), was) == 1
    coloured = structs.replace(session, score=structs.replace(session.score, colour_weight=0.1))
    assert better(was, structs.replace(was, score=0.9), coloured) == 0  # another rule
    still = structs.replace(session, physics=structs.replace(session.physics, enabled=False))
    assert better(impossible, was, still) == 0  # physics was not asked


def test_without_ground_truth_doubtful_answers_are_tried_and_rows_say_that_they_fit(tmp_path: Path) -> None:
    unknown = {"has_truth": False, "add_s_mm": None}
    rows = [row(0, **unknown, findings=because(Cause.IMPOSSIBLE)), row(1, **{**unknown, "score": 0.2})]
    rows += [row(2, **unknown, n_alike=1), *(row(3 + k, **unknown) for k in range(4))]
    write_run(tmp_path / "run", rows)
    request = FixRequest(folder=tmp_path / "run")
    runs = request.runs()
    trials = request.trials(runs)
    for trial in trials:
        names = trial.jobs["run"].session.scene.frames
        solved = [structs.replace(one, findings=(), score=0.9) for one in rows if one.frame in names]
        write_run(trial.jobs["run"].folder, solved)
    table = request.table(trials, runs)
    assert {line.judged_by for line in table.rows} == {"fit"}
    assert {line.cause for line in table.rows} == {Cause.IMPOSSIBLE, Cause.POOL}  # colour counts already
    (pool,) = [line for line in table.rows if line.remedy == "hypotheses.max_per_object x2"]
    assert (pool.tried, pool.came_right, pool.worse, pool.right_tried, pool.right_known) == (1, 1, 0, 1, 4)


def test_an_interval_is_narrower_the_more_were_tried_and_never_beyond_all() -> None:
    for k, n in ((0, 1), (1, 1), (3, 7), (50, 100)):
        low, high = wilson(k, n)
        assert 0 <= low <= k / n <= high <= 1
    few, many = net_gain([(1, 3, 6, 60)]), net_gain([(1, 30, 60, 60)])
    assert few[0] == many[0] == 30
    assert few[1] < many[1] < 30 < many[2] < few[2]
    assert net_gain([(1, 2, 4, 4), (-1, 0, 4, 100)])[1] < 0  # that none of four broke does not say that none would
    assert net_gain([(1, 0, 0, 0)]) == (0.0, 0.0, 0.0)
    assert trials_of({}, Path()) == ()


def _without_times(folder: Path) -> list[dict[str, str]]:
    with (folder / CSV_FILE).open(newline="") as file:
        return [{k: v for k, v in line.items() if k != "seconds_added"} for line in csv.DictReader(file)]


@pytest.mark.timeout(900)  # Three batches, whose processes may have to compile first.
@pytest.mark.usefixtures("processes")
def test_a_killed_fix_gives_the_same_table_and_the_written_session_the_same_answers(tmp_path: Path) -> None:
    session = write_light_frames(tmp_path, 6)
    text = session.read_text().replace("rotation_deg = 10.0", "rotation_deg = 60.0").replace('"sir"', '"rir"')
    session.write_text(text.replace("max_per_object = 2", "max_per_object = 1"))
    run, whole, killed = tmp_path / "run", tmp_path / "whole", tmp_path / "killed"
    assert batch_here(session, run, "--workers", 1).returncode == 0
    wrong = [row for row in read_batch(run).rows if row.is_correct is not True]
    assert 0 < len(wrong) < 6
    fix = command("fix", run, "--take", "physics.enabled", "--workers", 1)
    subprocess.run([*fix, "--out", whole, "--write", tmp_path / "mended.toml"], check=True, capture_output=True)
    again = [*fix, "--out", str(killed)]
    killed_until_done(again, lambda: len([*killed.glob("*/runs/*.vfrun")]), 1, random.Random(1))
    assert _without_times(killed) == _without_times(whole)
    assert all(int(one["right_tried"]) >= min(int(one["tried"]), 6 - len(wrong)) for one in _without_times(whole))

    job = next(jobs_of(FixRequest(folder=run, out=killed).trials({"run": read_batch(run)})))
    lost = failed_run(job.session, {}, job.session.scene.frames[0], "no memory")
    Runs(job.folder / "runs").save(job.session, lost)
    assert subprocess.run(again, capture_output=True, text=True).returncode == 1
    assert _without_times(killed) != _without_times(whole)
    subprocess.run([*again, "--retry-failed"], check=True, capture_output=True)
    assert _without_times(killed) == _without_times(whole)

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
    assert _without_times(tmp_path / "stopped") == _without_times(whole)

    mended = tmp_path / "mended"
    assert batch_here(tmp_path / "mended.toml", mended, "--workers", 1, "--no-diagnose").returncode == 0
    now = {(row.frame, row.instance_id): row.add_s_mm for row in read_batch(mended).rows}
    of_it = [one for one in read_json(whole / FIX_FILE, FixTable).answers if one.remedy == PHYSICS]
    assert of_it
    for one in of_it:
        assert now[one.frame, one.instance_id] == one.errors_mm[1]
