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
