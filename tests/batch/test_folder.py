"""The folder of a batch: what a restart may build on, and who may write."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from tests.made_runs import answer, finished
from verefine_viz.batch.folder import RunFolder, first_change
from verefine_viz.batch.runs import BatchInfo, read_run
from verefine_viz.core.errors import InputError, SettingsError, UnavailableError
from verefine_viz.core.settings import Session
from verefine_viz.run.answers import table_lines
from verefine_viz.run.record import RunRecord, failed_run
from verefine_viz.run.session_file import load_session, resolve

SESSION = resolve({"title": "a", "method": {"name": "sir"}})


def solved(frame: str, score: float = 0.5) -> RunRecord:
    return finished(frame, [answer(1, 2, score=score)])


def tables(records: Iterable[RunRecord]) -> list[tuple[str, str]]:
    """What they say, frame by frame."""
    return [(record.header.frame, table_lines(record)) for record in records]


def test_a_new_folder_holds_the_session_that_runs(tmp_path: Path) -> None:
    RunFolder(tmp_path / "deep" / "out", SESSION).close()
    assert load_session(tmp_path / "deep" / "out" / "session.toml") == SESSION


def test_finished_frames_are_found_again(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, SESSION)
    two, three = solved("1/2", 1 / 3), solved("1/3")
    for one in (two, three):
        folder.runs.save(SESSION, one)
    folder.close()
    again = RunFolder(tmp_path, SESSION)
    assert tables(again.runs.records(["1/3", "1/4", "1/2"])) == tables([three, two])
    assert again.runs.frames == ("1/2", "1/3")
    again.close()


def test_damaged_entries_do_not_count(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, SESSION)
    runs, failed, other = folder.runs, failed_run(SESSION, "1/2", "no depth"), solved("1/3")
    runs.save(SESSION, failed)
    runs.save(SESSION, other)
    runs.path("1/4").write_bytes(runs.path("1/3").read_bytes()[:-20])
    runs.path("1/5").write_bytes(runs.path("1/3").read_bytes())
    runs.path("1/7").write_text("1,3,0.5")
    assert tables(runs.records(f"1/{k}" for k in range(10))) == tables([failed, other])
    with pytest.raises(InputError, match=r"000001_000005\.vfrun is damaged: it is about frame 1/3"):
        runs.entry("1/5")
    runs.forget("1/2")
    runs.forget("1/2")
    assert runs.entry("1/2") is None
    folder.close()


def test_another_session_is_refused_by_its_first_difference(tmp_path: Path) -> None:
    RunFolder(tmp_path, SESSION).close()
    other = resolve({"title": "a", "method": {"name": "rir"}})
    with pytest.raises(SettingsError, match=r"method\.name is 'sir' there and 'rir' here; choose another --out"):
        RunFolder(tmp_path, other)
    assert load_session(tmp_path / "session.toml") == SESSION


@pytest.mark.parametrize(
    ("there", "here", "said"),
    [
        ({}, {"scene": {"frames": ["0/1", "0/2"]}}, "scene.frames is [] there and ['0/1', '0/2'] here"),
        ({}, {"physics": {"enabled": False}}, "physics.enabled is true there and false here"),
        ({}, {"hypotheses": {"rotation_deg": 5.5}}, "hypotheses.rotation_deg is 30.0 there and 5.5 here"),
        (
            {"changes": [{"after_iteration": 3, "settings": {"score": {"tau_m": 0.01}}}]},
            {"changes": [{"after_iteration": 4, "settings": {"score": {"tau_m": 0.01}}}]},
            "the [[changes]] there are others than those here",
        ),
    ],
)
def test_what_differs_is_written_as_in_a_session_file(there: dict[str, Any], here: dict[str, Any], said: str) -> None:
    assert first_change(resolve(there), resolve(here)) == said


def test_another_version_is_refused(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, SESSION)
    folder.write_json("run.json", {"version": "0.0.1"})
    folder.close()
    with pytest.raises(SettingsError, match=r"begun by version 0\.0\.1"):
        RunFolder(tmp_path, SESSION)


def test_a_folder_with_other_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match=r"holds other files \(thesis\.tex\) and no batch run"):
        RunFolder(tmp_path, SESSION)
    assert sorted(p.name for p in tmp_path.iterdir() if p.name != ".lock") == ["thesis.tex"]


@pytest.mark.parametrize("others", [(), ("thesis.tex",)])
def test_a_lock_that_is_a_link_leaves_what_it_leads_to_alone(others: tuple[str, ...], tmp_path: Path) -> None:
    theirs, out = tmp_path / "theirs.txt", tmp_path / "out"
    theirs.write_text("years of work")
    out.mkdir()
    for name in others:
        (out / name).touch()
    (out / ".lock").symlink_to(theirs)
    with pytest.raises(InputError, match=r"holds other files" if others else r"\.lock: it is a link to .*theirs\.txt"):
        RunFolder(out, SESSION)
    assert theirs.read_text() == "years of work"
    assert sorted(p.name for p in out.iterdir()) == [".lock", *others]


def test_a_folder_of_something_else_gets_no_lock(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(InputError, match="holds other files"):
        RunFolder(tmp_path, SESSION)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.usefixtures("processes")
def test_half_written_files_of_killed_processes_go_and_those_of_others_stay(tmp_path: Path) -> None:
    RunFolder(tmp_path, SESSION).close()
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    gone = ["frames.csv.1-2.part", "errors/000001_000002.txt.1-2.part", f"report.html.{ended.pid}-1.part"]
    kept = ["recordings/000001_000003.rrd", f"report.html.{os.getpid()}-1.part", "mine.part"]
    for name in (*gone, *kept):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    RunFolder(tmp_path, SESSION).close()
    assert [name for name in (*gone, *kept) if (tmp_path / name).exists()] == kept


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="is a file, expected a folder"):
        RunFolder(tmp_path / "out", SESSION)


def test_only_one_process_writes(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, SESSION)
    with pytest.raises(UnavailableError, match="another batch is writing"):
        RunFolder(tmp_path, SESSION)
    folder.close()
    RunFolder(tmp_path, SESSION).close()


@pytest.mark.usefixtures("processes")
def test_a_killed_writer_leaves_no_lock(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom pathlib import Path\nfrom tests.batch.test_folder import SESSION\n"
        "from verefine_viz.batch.folder import RunFolder\n"
        "folder = RunFolder(Path(sys.argv[1]), SESSION)\nprint('locked', flush=True)\nsys.stdin.read()\n"
    )
    root = Path(__file__).resolve().parents[2]
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=root,
    )  # fmt: skip
    with child:
        assert child.stdout is not None
        assert child.stdout.readline() == "locked\n"
        with pytest.raises(UnavailableError):
            RunFolder(tmp_path, SESSION)
        os.kill(child.pid, signal.SIGKILL)
    assert child.returncode == -signal.SIGKILL
    RunFolder(tmp_path, SESSION).close()


def test_nothing_is_half_written_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = RunFolder(tmp_path, SESSION)
    folder.write_json("run.json", {"version": "old"})
    before = (tmp_path / "run.json").read_text()

    def full(self: Path | int, *_: object, **__: object) -> int:
        if isinstance(self, Path):
            self.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(InputError, match=r"cannot write .*run\.json: No space left on device"):
        folder.write_json("run.json", {"version": "new"})
    assert (tmp_path / "run.json").read_text() == before
    monkeypatch.setattr(os, "write", full)
    with pytest.raises(InputError, match=r"cannot write .*000001_000002\.vfrun: No space left on device"):
        folder.runs.save(SESSION, solved("1/2"))
    assert folder.runs.read("1/2") is None
    folder.close()


@pytest.mark.parametrize("text", ["", "[1]", '{"version": 3}', '{"seconds": -1}', '{"totals": {"frames": "many"}}'])
def test_a_foreign_run_json_is_one_clear_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(InputError, match=r"run\.json: "):
        read_run(tmp_path)


def test_run_json_is_read_back(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(json.dumps({"seconds": 3}))
    assert read_run(tmp_path) == BatchInfo(seconds=3)
    assert read_run(tmp_path / "nowhere") == BatchInfo()


def test_the_first_change_names_field_and_values() -> None:
    assert first_change(SESSION, SESSION) is None
    changed = resolve({"title": "a", "method": {"name": "sir"}, "score": {"tau_m": 0.01}})
    assert first_change(SESSION, changed) == "score.tau_m is 0.02 there and 0.01 here"
    assert first_change(Session(), SESSION) == "title is '' there and 'a' here"
