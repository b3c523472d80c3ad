"""Bad output places, ports, batches and recordings: one clear line on stderr, exit code 2, nothing half-written."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import rerun as rr

from tests.batch.frames import PoolHere
from tests.cli.bad_input_sessions import BadInput
from verefine_viz.studies import run_study

ROOT = Path(__file__).resolve().parents[2]


# --out


@pytest.mark.usefixtures("processes")
def test_out_is_a_file(bad_input: BadInput) -> None:
    bad_input.file("out", "precious")
    assert "is a file, expected a folder" in bad_input.batch(bad_input.bop())
    assert (bad_input.folder / "out").read_text() == "precious"


BELOW: dict[str, Callable[[BadInput], list[object]]] = {
    "batch": lambda d: ["batch", d.bop(), "--out"],
    "batch of several": lambda d: ["batch", d.bop(), "--methods", "pir", "sir", "--out"],
    "estimate": lambda d: ["estimate", d.bop(), "--hypotheses.source", "ppf", "--out"],
    "study": lambda d: ["study", "ablation", "--quick", "--out"],
    "report": lambda d: ["report", d.batch_folder(), "--out"],
    "datasets": lambda d: ["datasets", "fetch", "ycbv", "--folder"],
}


@pytest.mark.usefixtures("processes")
def test_out_is_below_a_file(bad_input: BadInput) -> None:
    file = bad_input.file("thing", "precious")
    for command, words_of in BELOW.items():
        words = words_of(bad_input)
        said = bad_input.refused(*words, file / "out")
        assert said.startswith(f"cannot write to {words[-1]} {file / 'out'}"), command
        assert said.endswith(f": {file} is a file, not a folder; choose another {words[-1]}"), command
    assert file.read_text() == "precious"


@pytest.mark.usefixtures("processes")
def test_out_is_no_place_to_write_to(bad_input: BadInput) -> None:
    for command in ("batch", "estimate"):
        said = bad_input.refused(*BELOW[command](bad_input), "/proc/runs")  # It refuses even root.
        assert said.endswith(" in /proc (No such file or directory); choose another --out")
    assert "File name too long" in bad_input.refused(*BELOW["batch"](bad_input), bad_input.folder / ("n" * 300))


@pytest.mark.parametrize("command", ["estimate", "report"])
def test_out_is_a_folder_instead_of_a_file(bad_input: BadInput, command: str) -> None:
    assert "is a folder, expected the name of a file, for example" in bad_input.refused(
        *BELOW[command](bad_input), bad_input.folder
    )


@pytest.mark.parametrize("command", ["batch", "batch of several", "estimate"])
def test_out_lies_among_the_images(bad_input: BadInput, command: str) -> None:
    split = bad_input.made.root / "test"
    out = split / "000007" / "run" / "new.csv"
    said = bad_input.refused(*BELOW[command](bad_input), out)
    assert said.startswith(f"--out {out} lies among the images of the data set, in {split}")
    assert not out.parent.exists()


@pytest.mark.usefixtures("processes")
def test_the_home_folder_that_a_shell_left_alone(bad_input: BadInput, monkeypatch: pytest.MonkeyPatch) -> None:
    bad_input.file("runs/thesis.tex", "")
    monkeypatch.setenv("HOME", str(bad_input.folder))
    bad_input.bop()
    said = bad_input.refused("batch", "~/session.toml", "--out=~/runs")
    assert said.startswith(f"{bad_input.folder / 'runs'} holds other files (thesis.tex)")


@pytest.mark.usefixtures("processes")
def test_out_holds_a_damaged_session(bad_input: BadInput) -> None:
    bad_input.file("out/session.toml", "[[[")
    assert "is not TOML" in bad_input.batch(bad_input.bop())


# Inputs

INPUTS: dict[str, Callable[[BadInput, Path], list[object]]] = {
    "view": lambda d, x: ["view", x],
    "batch": lambda d, x: ["batch", x, "--out", d.folder / "out"],
    "estimate": lambda d, x: ["estimate", x, "--out", d.folder / "pool.csv"],
    "study": lambda d, x: ["study", "ablation", "--session", x, "--out", d.folder / "out"],
}


@pytest.mark.parametrize("command", INPUTS)
def test_an_input_that_is_no_file_is_one_line_at_once(bad_input: BadInput, command: str) -> None:
    pipe, missing = bad_input.folder / "pipe.toml", bad_input.folder / "none.toml"
    os.mkfifo(pipe)
    for path, expected in ((pipe, "is a pipe"), (missing, "does not exist")):
        said = bad_input.refused(*INPUTS[command](bad_input, path))
        assert f"{path} {expected}" in said


def test_a_value_of_thousands_of_letters_is_cut(bad_input: BadInput) -> None:
    assert len(bad_input.refused("view", "--method.name", "x" * 5000)) < 500


def test_frames_and_pictures_that_no_report_holds(bad_input: BadInput) -> None:
    for flag, n, most in (("--embed", -1, 200), ("--embed", 201, 200), ("--pictures", 10_001, 10_000)):
        assert bad_input.refused("report", bad_input.folder, flag, n) == f"{flag} is {n}, expected 0 to {most}"


# view


@pytest.mark.usefixtures("processes")
def test_the_port_is_taken(bad_input: BadInput) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert str(port) in bad_input.refused("view", "--port", port)


@pytest.mark.usefixtures("processes")
def test_make_takes_the_port_that_is_advised() -> None:
    # Within another make, it tells of folders as well.
    command = ["make", "-n", "--no-print-directory", "app", "PORT=1234"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.splitlines()[-1].endswith("app.py sessions/mug.toml --port 1234")


def test_a_port_that_does_not_exist(bad_input: BadInput) -> None:
    assert "65536" in bad_input.refused("view", "--port", "65536")


@pytest.mark.usefixtures("processes")
def test_a_host_that_is_not_this_machine(bad_input: BadInput) -> None:
    for host in ("192.0.2.1", "no.such.host.invalid"):
        assert host in bad_input.refused("view", "--host", host, "--port", "0")
    assert "is no name of a machine" in bad_input.refused("view", "--host", "a\udcff", "--port", "0")


def test_report_of_what_is_no_folder(bad_input: BadInput) -> None:
    file, missing = bad_input.file("thesis.tex", ""), bad_input.folder / "nowhere"
    assert f"{file} is a file; expected the folder of a batch run" in bad_input.refused("report", file)
    assert f"{missing} does not exist" in bad_input.refused("report", bad_input.batch_folder(), missing)


def test_a_file_is_no_data_set(bad_input: BadInput) -> None:
    assert "thesis.tex is a file; give the folder" in bad_input.refused(
        "datasets", "check", bad_input.file("thesis.tex", "")
    )


def test_view_of_a_folder_that_is_no_batch(bad_input: BadInput) -> None:
    assert "is no folder of a batch: it has no run.json" in bad_input.refused("view", bad_input.folder)
    session = bad_input.file("session.toml", '[scene]\ndemo = "mug"\n')
    said = f"it has no run.json; its session opens by verefine-viz view {session}"
    assert said in bad_input.refused("view", session.parent)


def test_view_of_a_batch_without_a_finished_frame(bad_input: BadInput) -> None:
    folder = bad_input.batch_folder()
    said = f"{folder} has no finished frame yet: the batch is running or was killed; run it again"
    assert bad_input.refused("view", folder) == said
    for content in ("", "7,3,5", "VEREFINE RUN\n"):
        bad_input.file(f"{folder.name}/runs/000007_000003.vfrun", content)
        assert bad_input.refused("view", folder) == said


# replay


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("verify", [[], ["--verify"]])
def test_what_is_no_recording(bad_input: BadInput, verify: list[str]) -> None:
    file = bad_input.folder / "run.rrd"
    assert "does not exist" in bad_input.refused("replay", file, *verify)
    for content, expected in (
        (b"", "is empty; expected a recording"),
        (b"PK\x03\x04 not a recording", "is not a rerun recording"),
        (b"RRF2 and then rubbish", ".rrd"),
    ):
        file.write_bytes(content)
        assert expected in bad_input.refused("replay", file, *verify), content
    run = bad_input.batch_folder()
    for folder in (run, run.parent):
        assert f"; those of a batch lie in {run / 'runs'}" in bad_input.refused("replay", folder, *verify)


def test_two_runs_to_view_are_reported_how_to_compare_and_where_they_are(bad_input: BadInput) -> None:
    run = bad_input.batch_folder()
    assert "report RUN_A RUN_B" in bad_input.refused("view", run, run)
    assert bad_input.refused("view", run, run.parent).endswith(f"; runs in {run.parent}: {run}")


@pytest.mark.usefixtures("processes")
def test_a_recording_of_another_program(bad_input: BadInput) -> None:
    file = bad_input.folder / "other.rrd"
    rec = rr.RecordingStream("somebody_else")
    rec.save(file)
    rec.log("scalar", rr.Scalars(1.0))
    rec.flush()
    rec.disconnect()
    assert "other.rrd" in bad_input.refused("replay", file, "--verify")


# As a process of its own


@pytest.mark.usefixtures("processes")
def test_the_real_program_says_one_line_and_exits_2(tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    program = [sys.executable, "-m", "verefine_viz.cli", "batch", "none.toml", "--out", "out"]
    done = subprocess.run(program, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("verefine-viz: ")
    assert "does not exist" in done.stderr
    assert list(tmp_path.iterdir()) == []


# study grasping


@pytest.mark.usefixtures("processes")
def test_what_cannot_be_grasped_is_named_in_one_line(bad_input: BadInput, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_study, "Pool", PoolHere)
    layout = ("--scene.source", "layout", "--scene.dataset", bad_input.made.root, "--scene.layout")
    cases = (
        ((*layout, bad_input.file("notes.xml", "banana")), "it cannot be read as XML"),
        (("--scene.demo", "duck", "--grasp.folder", bad_input.folder / "none"), "is no folder"),
        (("--scene.demo", "duck", "--grasp.opening-m", "0.02"), "frame 0/0: no object can be gripped"),
    )
    for k, (words, expected) in enumerate(cases):
        out = bad_input.folder / f"out {k}"
        assert expected in bad_input.refused("study", "grasping", "--workers", "1", "--out", out, *words)
