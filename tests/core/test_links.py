"""Links in a folder of results: nothing is written through one, whatever writes there, and whatever it leads to."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import verefine_viz
from tests.fakes import box_problem
from tests.made_runs import answer, finished
from tests.run.kept_frames import box_mesh, found, kept
from verefine_viz.batch.folder import RunFolder
from verefine_viz.batch.jobs import session_jobs, sweep_jobs
from verefine_viz.batch.runs import Runs
from verefine_viz.batch.watch import Watch
from verefine_viz.commands.estimate_frames import write_pools
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import atomic, make_inside, new_file, write_json
from verefine_viz.recording.recording_file import RecordingFile
from verefine_viz.recording.sequence_recording import write_sequence
from verefine_viz.run.record import FORMAT, RunEnd, RunHeader
from verefine_viz.run.run_file import RunFile, read_run_file
from verefine_viz.run.session_file import CAPTURE_HEAD, save_session
from verefine_viz.scenes.labels import write_labels
from verefine_viz.studies.study_command import run_one
from verefine_viz.trace import Trace

THEIRS = "years of work"
HEADER = RunHeader(FORMAT, "", "1/2", "", {}, ())


def run_file(path: Path) -> None:
    file = RunFile(path, Session())
    file.begin(HEADER)
    file.finish(RunEnd(answers=(answer(1, 2),)))


def part_of(path: Path) -> None:
    with atomic(path.parent / "table.csv") as part:
        part.unlink()
        part.symlink_to(path.parent.parent / "theirs.txt")
    with atomic(path) as part:
        part.write_text("ours")


WRITERS: dict[str, Callable[[Path], object]] = {
    "1.vfrun": run_file,
    "1.rrd": lambda path: RecordingFile(path).close(),
    "sequence.rrd.part": lambda path: write_sequence(path.with_suffix(""), "", ()),
    "run.json": lambda path: write_json(path, {}),
    "table.csv": part_of,
    "session.toml": lambda path: save_session(Session(), path),
    "labels.json": lambda path: write_labels(path, {"1/1": ()}),
    "depth.npy": lambda path: Trace(path.parent, np.eye(3), np.ones((4, 5))),
    "rgb.npy": lambda path: Trace(path.parent, np.eye(3), np.ones((4, 5)), np.zeros((4, 5, 3), np.uint8)),
    "mask_0.npy": lambda path: Trace(path.parent, np.eye(3), np.ones((4, 5))).object("a", "a.ply", np.ones((4, 5))),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_link_is_replaced_and_what_it_leads_to_stays(name: str, tmp_path: Path) -> None:
    theirs, out = tmp_path / "theirs.txt", tmp_path / "out"
    for target in (theirs, tmp_path / "nothing"):
        theirs.write_text(THEIRS)
        out.mkdir()
        (out / name).symlink_to(target)
        WRITERS[name](out / name)
        assert theirs.read_text() == THEIRS, target
        assert not (tmp_path / "nothing").exists()
        out.rename(tmp_path / f"{target.name}.out")


def test_a_half_written_file_is_no_link_that_lay_there(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs.txt"
    theirs.write_text(THEIRS)
    with atomic(tmp_path / "table.csv") as part:
        pass
    part.symlink_to(theirs)
    with atomic(tmp_path / "table.csv") as part:
        part.write_text("ours")
    assert (theirs.read_text(), (tmp_path / "table.csv").read_text()) == (THEIRS, "ours")


def test_a_second_name_of_a_file_elsewhere_keeps_its_content(tmp_path: Path) -> None:
    theirs, ours = tmp_path / "theirs.txt", tmp_path / "1.vfrun"
    theirs.write_text(THEIRS)
    ours.hardlink_to(theirs)
    run_file(ours)
    assert theirs.read_text() == THEIRS
    assert read_run_file(ours).is_complete


FOLDERS: dict[str, Callable[[Path], object]] = {
    "runs": lambda out: begin_batch(out),
    "recordings": lambda out: begin_batch(out),
    "errors": lambda out: begin_batch(out),
    "rir-0": lambda out: sweep_jobs([None], out, {}, ["rir"], 1),
    "a": lambda out: session_jobs([out.parent / "a.toml", out.parent / "b.toml"], out, {}),
    "pool.csv.journal": lambda out: write_pools(out.parent / "a.toml", out / "pool.csv", {}),
    "ablation.journal": lambda out: run_one("ablation", None, out, {}, quick=True),
    "models": lambda out: keep_frame(out),
    "test": lambda out: keep_frame(out),
    "test/000001": lambda out: keep_frame(out),
    "test/000001/depth": lambda out: keep_frame(out),
    "test/000001/rgb": lambda out: keep_frame(out),
    "watched": lambda out: watch(out),
}


def begin_batch(out: Path) -> None:
    save_session(Session(), out / "session.toml")
    RunFolder(out, Session()).close()


def keep_frame(out: Path) -> None:
    (out / "session.toml").write_text(CAPTURE_HEAD)
    problem = box_problem()
    kept(out, problem, [found(problem, box_mesh(out.parent / "box.ply"))])


def watch(out: Path) -> None:
    (out.parent / "watched").mkdir()
    Trace(out.parent / "watched", np.eye(3), np.ones((4, 5))).close()
    watch = Watch(out.parent / "watched", out)
    watch.look()
    watch.close()
    raise InputError(watch.latest[1])


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_in_ones_own_that_is_a_link_is_refused(name: str, tmp_path: Path) -> None:
    theirs, out = tmp_path / "theirs", tmp_path / "out"
    for file in ("a.toml", "b.toml"):
        (tmp_path / file).write_text('hypotheses.source = "ppf"\n')
    (out / name).parent.mkdir(parents=True)
    theirs.mkdir()
    (theirs / "a.part").write_text(THEIRS)
    (out / name).symlink_to(theirs)
    with pytest.raises(InputError, match=rf"^cannot write to .*{name}: it is a link to .*theirs, expected a folder; "):
        FOLDERS[name](out)
    assert [(path.name, path.read_text()) for path in theirs.iterdir()] == [("a.part", THEIRS)]


def test_the_folder_that_is_named_may_be_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    RunFolder(tmp_path / "out", Session()).close()
    Runs(tmp_path / "out" / "runs").save(Session(), finished("1/2", [answer(1, 2)]))
    make_inside(tmp_path / "out", "a/b")
    keep_frame(tmp_path / "out" / "a")
    assert {path.name for path in (tmp_path / "disk").iterdir()} >= {"runs", "session.toml", "a"}
    assert Runs(tmp_path / "disk" / "runs").entry("1/2") is not None


def test_what_is_no_file_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="a is a folder"):
        new_file(tmp_path / "a")
    with pytest.raises(InputError, match="null"):
        new_file(Path("/dev/null"))


WRITES = re.compile(
    r"\.write_(text|bytes)\(|\bopen\([^)]*[\"'][wax+]b?[\"']|np\.savez?\(|os\.open\(|\.mkdir\(|shutil\.copy|\bto_csv\("
)
PLAIN = {
    "core/writing.py": "the rule itself",
    "core/files.py": "opens for reading",
    "trace.py": "new folders and new files alone, as it must do without the rest",
    "physics/world.py": "in a temporary folder",
    "physics/decomposition.py": "in a temporary folder",
    "cli.py": "/dev/null",
    "page/export.py": "a folder of the user's, and new names in it",
    "batch/watch.py": "the folder that the user names",
    "commands/doctor_checks.py": "the user's cache folder",
    "estimators/ppf_model.py": "into memory",
    "core/array_cache.py": "into a file of atomic's",
    "core/kernels.py": "the user's cache folder",
}
"""Files that write otherwise than by ``atomic`` and ``new_file``, and why they may."""


def test_every_place_that_writes_goes_by_the_rule() -> None:
    root = Path(verefine_viz.__file__).parent
    others = set()
    for file in root.rglob("*.py"):
        for line in file.read_text().splitlines():
            if WRITES.search(line) and not re.search(r"\b(part|file)\.(write_|open)|\(.*, part\)", line):
                others.add(str(file.relative_to(root)))
    assert others == {*PLAIN}
