"""What a command is to run: names, seeds, and what is refused before anything runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec import structs

from verefine_viz import cli
from verefine_viz.batch.jobs import BatchJob, check_jobs, session_jobs, sweep_jobs
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import resolve


@pytest.fixture
def sessions(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / "a.toml", tmp_path / "b.toml"]
    for path in paths:
        path.write_text(f'title = "{path.stem}"\n[method]\nname = "sir"\nseed = 7\n')
    return paths


def seeds(job: BatchJob) -> tuple[int, int]:
    return job.session.hypotheses.seed, job.session.method.seed


def test_every_method_runs_with_every_seed_in_a_folder_of_its_own(sessions: list[Path], tmp_path: Path) -> None:
    jobs = sweep_jobs(sessions[:1], tmp_path / "out", {}, ("pir", "rir"), 3)
    found = {job.folder.name: (job.session.method.name, seeds(job)) for job in jobs}
    assert found == {f"{method}-{k}": (method, (k, k)) for method in ("pir", "rir") for k in range(3)}
    # All methods with the first seed come first.
    assert [job.folder.name for job in jobs[:3]] == ["pir-0", "rir-0", "pir-1"]
    assert {job.session.title for job in jobs} == {"a"}


def test_several_sessions_put_their_names_before(sessions: list[Path], tmp_path: Path) -> None:
    jobs = sweep_jobs(sessions, tmp_path / "out", {}, ("pir",), 1)
    assert [job.folder for job in jobs] == [tmp_path / "out" / "a-pir-0", tmp_path / "out" / "b-pir-0"]


def test_without_seeds_or_methods_the_sessions_own_hold(sessions: list[Path], tmp_path: Path) -> None:
    (only_methods,) = sweep_jobs(sessions[:1], tmp_path / "out", {}, ("pir",), None)
    assert (only_methods.folder.name, seeds(only_methods)) == ("pir", (0, 7))
    (only_seeds,) = sweep_jobs(sessions[:1], tmp_path / "out", {}, (), 1)
    assert (only_seeds.folder.name, only_seeds.session.method.name, seeds(only_seeds)) == ("sir-0", "sir", (0, 0))
    assert [job.folder for job in session_jobs(sessions[:1], tmp_path / "out", {})] == [tmp_path / "out"]
    assert [job.folder.name for job in session_jobs(sessions, tmp_path / "out", {})] == ["a", "b"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--methods", "pir", "ppir"), "unknown method 'ppir'; did you mean 'pir'? available: refine, "),
        (("--methods", "pir,sir"), "--methods pir,sir: separate the names by blanks, --methods pir sir"),
        (("--methods", "pir", "pir"), "--methods names 'pir' twice"),
        (("--seeds", "0"), "--seeds is 0, expected 1 or more"),
        (("--seeds", "1000000000"), "--seeds is 1000000000, expected 1000 or fewer"),
        (("--worker-memory-gb", "inf"), "--worker-memory-gb is inf, expected 100000 or less"),
        (("--worker-memory-gb", "nan"), "--worker-memory-gb is nan, expected more than 0"),
        (("--methods", "pir", "--method.name", "sir"), "--method.name and --methods contradict each other"),
        (("--seeds", "2", "--hypotheses.seed", "4"), "--hypotheses.seed and --seeds contradict each other"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line(
    sessions: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], expected: str
) -> None:
    assert cli.main(["batch", str(sessions[0]), "--out", str(tmp_path / "out"), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
    assert not (tmp_path / "out").exists()


def test_sessions_of_the_same_name_are_refused(sessions: list[Path], tmp_path: Path) -> None:
    with pytest.raises(VerefineError, match="two sessions are called 'a'"):
        sweep_jobs([sessions[0], tmp_path / "other" / "a.toml"], tmp_path / "out", {}, ("pir",), 2)


def test_a_folder_with_a_single_run_takes_no_sweep(sessions: list[Path], tmp_path: Path) -> None:
    (tmp_path / "session.toml").write_text("")
    with pytest.raises(VerefineError, match="holds a single run; choose another --out"):
        sweep_jobs(sessions, tmp_path, {}, ("pir",), 2)


def test_everything_is_checked_before_anything_runs(tmp_path: Path) -> None:
    good = Session()
    bad = structs.replace(good, method=structs.replace(good.method, refiner="ipc"))
    with pytest.raises(VerefineError, match="unknown refiner 'ipc'"):
        check_jobs([BatchJob(good, tmp_path / "good-0", "good"), BatchJob(bad, tmp_path / "bad-0", "bad")])
    assert not list(tmp_path.iterdir())


def test_a_folder_that_holds_another_run_is_found_before_anything_runs(tmp_path: Path) -> None:
    job = BatchJob(resolve({}), tmp_path / "rir-1", "rir")
    job.folder.mkdir()
    (job.folder / "session.toml").write_text("[score]\ntau_m = 0.5\n")
    with pytest.raises(VerefineError, match=r"holds a run of another session: score\.tau_m is 0\.5 there"):
        check_jobs([BatchJob(Session(), tmp_path / "rir-0", "rir"), job])
    assert not (tmp_path / "rir-0").exists()
