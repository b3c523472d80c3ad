"""The folder of a batch: what a restart may build on, and who may write."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.made_runs import answer, finished
from verefine_viz.batch.folder import RunFolder, first_change
from verefine_viz.batch.runs import BatchInfo, read_run
from verefine_viz.core.errors import InputError, SettingsError, UnavailableError
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.run.answers import table_lines
from verefine_viz.run.record import RunRecord
from verefine_viz.run.session_file import resolve

SESSION = resolve({"title": "a", "method": {"name": "sir"}})


def solved(frame: str, score: float = 0.5) -> RunRecord:
    return finished(frame, [answer(*parse_frame(frame), score=score)])


def tables(records: Iterable[RunRecord]) -> list[tuple[str, str]]:
    """What they say, frame by frame."""
    return [(record.header.frame, table_lines(record)) for record in records]


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


def test_what_differs_first_is_named_as_in_a_session_file() -> None:
    change = {"after_iteration": 3, "settings": {"score": {"tau_m": 0.01}}}
    for here, field in (
        ({"scene": {"frames": ["0/1", "0/2"]}}, "scene.frames"),
        ({"physics": {"enabled": False}}, "physics.enabled"),
        ({"changes": [change]}, "[[changes]]"),
    ):
        assert field in (first_change(resolve({}), resolve(here)) or "")
    assert first_change(resolve({}), resolve({})) is None


@pytest.mark.parametrize(
    ("name", "content", "error", "said"),
    [
        ("session.toml", 'title = "a"\n[method]\nname = "rir"\n', SettingsError, r"method\.name"),
        ("run.json", '{"version": "0.0.1"}', SettingsError, r"0\.0\.1"),
        ("thesis.tex", "years of work", InputError, r"thesis\.tex"),
        (".lock", None, InputError, r"theirs\.txt"),
    ],
)
def test_a_folder_of_something_else_is_refused_and_left_alone(
    name: str, content: str | None, error: type[Exception], said: str, tmp_path: Path
) -> None:
    theirs, out = tmp_path / "theirs.txt", tmp_path / "out"
    theirs.write_text("years of work")
    out.mkdir()
    if name == "run.json":
        RunFolder(out, SESSION).close()
    if content is None:
        (out / name).symlink_to(theirs)
    else:
        (out / name).write_text(content)
    with pytest.raises(error, match=said):
        RunFolder(out, SESSION)
    assert (out / name).read_text() == (content or "years of work")


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
        assert child.stdout.readline() == "locked\n"
        with pytest.raises(UnavailableError):
            RunFolder(tmp_path, SESSION)
        os.kill(child.pid, signal.SIGKILL)
    assert child.returncode == -signal.SIGKILL
    RunFolder(tmp_path, SESSION).close()


def test_run_json_is_read_back_and_a_foreign_one_is_one_clear_error(tmp_path: Path) -> None:
    for text in ("", '{"seconds": -1}'):
        (tmp_path / "run.json").write_text(text)
        with pytest.raises(InputError, match=r"run\.json: "):
            read_run(tmp_path)
    (tmp_path / "run.json").write_text(json.dumps({"seconds": 3}))
    assert read_run(tmp_path) == BatchInfo(seconds=3)
    assert read_run(tmp_path / "nowhere") == BatchInfo()
