"""Methods × seeds: jobs and their refusals; runs with the bits of single ones; the table after them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from tests.batch.frames import batch_here, damaged, depth_file
from tests.batch.killed_batches import without_times
from tests.made_runs import answer
from tests.report.runs import row, write_run
from tests.scenes.bop_folder import Made
from verefine_viz import cli
from verefine_viz.batch.batch_command import sweep_row, sweep_table
from verefine_viz.batch.jobs import BatchJob, check_jobs, session_jobs, sweep_jobs
from verefine_viz.batch.run_batch import BatchOutcome
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.settings import Session
from verefine_viz.report.bop_recalls import BopRecalls
from verefine_viz.report.group_numbers import compare
from verefine_viz.report.groups import read_runs, sections_of
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import resolve


@pytest.fixture
def sessions(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / "a.toml", tmp_path / "b.toml"]
    for path in paths:
        path.write_text(f'title = "{path.stem}"\n[method]\nname = "sir"\nseed = 7\n')
    return paths


def named(jobs: tuple[BatchJob, ...] | list[BatchJob]) -> list[tuple[str, str, int, int]]:
    """Folder, method, seed of the initial poses and of the method."""
    of = ((job.folder.name, job.session.method, job.session.hypotheses.seed) for job in jobs)
    return [(folder, method.name, seed, method.seed) for folder, method, seed in of]


def test_every_method_runs_with_every_seed_in_a_folder_of_its_own(sessions: list[Path], tmp_path: Path) -> None:
    out, one = tmp_path / "out", sessions[:1]
    jobs = sweep_jobs(one, out, {}, ("pir", "rir"), 3)
    # All methods with the first seed come first.
    assert named(jobs) == [(f"{method}-{k}", method, k, k) for k in range(3) for method in ("pir", "rir")]
    assert {job.session.title for job in jobs} == {"a"}
    assert [job.folder for job in sweep_jobs(sessions, out, {}, ("pir",), 1)] == [out / "a-pir-0", out / "b-pir-0"]
    # Without seeds or methods the session's own hold.
    assert named(sweep_jobs(one, out, {}, ("pir",), None)) == [("pir", "pir", 0, 7)]
    assert named(sweep_jobs(one, out, {}, (), 1)) == [("sir-0", "sir", 0, 0)]
    assert [job.folder for job in session_jobs(one, out, {})] == [out]
    assert [job.folder.name for job in session_jobs(sessions, out, {})] == ["a", "b"]


@pytest.mark.parametrize(
    "words",
    [
        ("--methods", "pir", "ppir"),
        ("--methods", "pir,sir"),
        ("--methods", "pir", "pir"),
        ("--seeds", "0"),
        ("--seeds", "1000000000"),
        ("--worker-memory-gb", "inf"),
        ("--worker-memory-gb", "nan"),
        ("--methods", "pir", "--method.name", "sir"),
        ("--seeds", "2", "--hypotheses.seed", "4"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line_that_names_it(
    sessions: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    assert cli.main(["batch", str(sessions[0]), "--out", str(tmp_path / "out"), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words[0] in line or words[-1] in line
    assert not (tmp_path / "out").exists()


def test_folders_of_jobs_that_are_taken_are_refused_before_anything_runs(sessions: list[Path], tmp_path: Path) -> None:
    with pytest.raises(VerefineError, match="'a'"):
        sweep_jobs([sessions[0], tmp_path / "other" / "a.toml"], tmp_path / "out", {}, ("pir",), 2)
    good, other = BatchJob(Session(), tmp_path / "rir-0", "rir"), BatchJob(resolve({}), tmp_path / "rir-1", "rir")
    bad = structs.replace(good.session, method=structs.replace(good.session.method, refiner="ipc"))
    with pytest.raises(VerefineError, match="'ipc'"):
        check_jobs([good, BatchJob(bad, tmp_path / "bad-0", "bad")])
    other.folder.mkdir()
    (other.folder / "session.toml").write_text("[score]\ntau_m = 0.5\n")
    with pytest.raises(VerefineError, match=r"score\.tau_m"):
        check_jobs([good, other])
    assert not good.folder.exists()
    (tmp_path / "session.toml").write_text("")
    with pytest.raises(VerefineError, match="--out"):
        sweep_jobs(sessions, tmp_path, {}, ("pir",), 2)


# Sweeps that are run

THREE = ("--scene.frames", "7/0", "7/1", "7/2", "--recording.keep", "none", "--hypotheses.max-per-object", 2)
SWEEP = (*THREE, "--methods", "pir", "rir", "--seeds", 2)


@pytest.mark.usefixtures("processes")
def test_a_sweep_lists_what_failed_by_run_goes_on_and_ends_with_the_bits_of_single_runs(
    session: Path, made: Made, tmp_path: Path
) -> None:
    out, single = tmp_path / "out", ("--method.name", "rir", "--method.seed", 1, "--hypotheses.seed", 1)
    with damaged(depth_file(made, 1)):
        done = batch_here(session, out, *SWEEP, "--workers", 2)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert done.stdout.count("frame 7/1 failed: ") == 4
    assert "4 frames failed" in done.stdout
    assert sorted(path.name for path in out.iterdir()) == ["pir-0", "pir-1", "rir-0", "rir-1"]
    before = without_times(out / "pir-0")
    (out / "pir-1/runs/000007_000002.vfrun").unlink()
    done = batch_here(session, out, *SWEEP, "--workers", 1, "--retry-failed")
    assert done.returncode == 0, done.stderr
    assert [done.stdout.count(f"3 frames ({n} done before)") for n in (1, 2)] == [1, 3]
    table = [line.split()[:2] for line in done.stdout.splitlines()]
    assert ["pir", "2"] in table
    assert ["rir", "2"] in table
    assert [row for row in without_times(out / "pir-0")[1] if row["im_id"] != "1"] == [
        row for row in before[1] if row["im_id"] != "1"
    ]
    assert batch_here(session, tmp_path / "rir", *THREE, *single, "--workers", 1).returncode == 0
    assert without_times(tmp_path / "rir") == without_times(out / "rir-1")
    assert without_times(out / "rir-0") != without_times(out / "rir-1")
    again = batch_here(session, out, *SWEEP, "--workers", 1)
    assert (again.returncode, again.stdout.count("; nothing was left to do")) == (0, 4)


# The table after a sweep

NO_ANSWER = {"status": "no_answer", "add_s_mm": None, "score": None, "ms_total": 0.0}


def rows_of(seed: int, worse: float) -> list[Answer]:
    """Frames with one to three objects, one of them without an answer, and one frame that failed as a whole."""
    rng = np.random.default_rng(seed)
    known = [
        row(f, i, add_s_mm=round(worse * rng.gamma(1, 6), 3), score=rng.random(), ms_total=round(100 * rng.random(), 3))
        for f in range(1, 6 + seed)
        for i in range(1 + f % 3)
    ]
    return [*known, row(1, 7, **NO_ANSWER), answer(scene_id=1, im_id=99, status="failed", message="no depth")]


def test_the_table_has_the_numbers_of_the_report_and_the_best_comes_first(tmp_path: Path) -> None:
    outcomes: list[tuple[BatchJob, BatchOutcome]] = []
    for method, worse in (("pir", 2.0), ("rir", 1.0)):
        for seed in range(3):
            settings = {"method": {"name": method, "seed": seed}, "hypotheses": {"seed": seed}}
            run = write_run(tmp_path / f"{method}-{seed}", rows_of(seed, worse), settings)
            outcomes.append((BatchJob(resolve({}), run, method), BatchOutcome(run, {}, (), 0, 1.0, "")))
    assert [row[:2] for row in sweep_table(outcomes).rows] == [("rir", "3"), ("pir", "3")]
    read, _ = read_runs([job.folder for job, _ in outcomes], only_finished=True)
    (section,) = sections_of(read)
    assert len(section.groups) == 2
    for line in compare(section, BopRecalls()).lines:
        mine = sweep_row(run.rows for run in line.group.runs)
        theirs = [line.numbers[name].value for name in ("recall", "median_mm", "score", "ms_per_frame")]
        assert [mine.recall, mine.median_mm, mine.score, mine.ms_per_frame] == pytest.approx(theirs)
        assert mine.n_runs == len(line.group.runs)


def test_objects_of_all_runs_count_the_same() -> None:
    """A run of few objects weighs less: neither medians nor recalls of runs are averaged."""
    few, many = [row(1, add_s_mm=50.0, score=0.1)], [row(k, add_s_mm=float(k), score=0.9) for k in range(1, 10)]
    found = sweep_row([few, many])
    assert (found.recall, found.ends, found.median_mm) == (0.9, (0.0, 1.0), 5.5)
    assert found.score == pytest.approx(0.82)
    assert found.ms_per_frame == 40.0
