"""Bad input at the command line: one clear line on stderr, exit code 2, no traceback, nothing half-written."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import rerun as rr

from tests.batch import fragile
from tests.cli.command_line import CommandLine
from tests.scenes.bop_folder import Made, make
from verefine_viz.batch import pool
from verefine_viz.batch.folder import RunFolder
from verefine_viz.session.files import resolve

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make(tmp_path_factory.mktemp("data"))


@pytest.fixture(autouse=True)
def _quick_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    # Bad input must be refused before the first frame is solved; a real worker would only cost time.
    monkeypatch.setattr(pool, "work", fragile.work)


class Desk(CommandLine):
    """What a case works with."""

    def bop(self, extra: str = "", scene: str = "", hypotheses: str = "") -> Path:
        """A session on the made-up data set."""
        text = f'{extra}\n[scene]\nsource = "bop"\ndataset = {json.dumps(str(self.made.root))}\n{scene}\n'
        return self.file("session.toml", f"{text}[hypotheses]\n{hypotheses}\n")

    def batch(self, session: Path, *words: object) -> str:
        return self.refused("batch", session, "--out", self.folder / "out", *words)


@pytest.fixture
def desk(tmp_path: Path, made: Made, capsys: pytest.CaptureFixture[str]) -> Desk:
    return Desk(tmp_path, made, capsys)


Case = tuple[Callable[[Desk], Path], str]

SESSION_FILES: dict[str, Case] = {
    "missing": (lambda d: d.folder / "none.toml", "none.toml does not exist"),
    "a folder": (lambda d: d.folder, "cannot be read: it is a folder, expected a .toml file"),
    "the folder of a batch": (lambda d: batch_folder(d), "did you mean "),
    "not TOML": (lambda d: d.file("s.toml", "[scene\n"), "is not TOML"),
    "JSON instead of TOML": (lambda d: d.file("s.toml", '{"scene": {}}'), "is not TOML"),
    "not text": (lambda d: d.file("s.toml", b"\xff\xfe\x00"), "cannot be read: it is no text, expected a .toml file"),
    "unknown section": (lambda d: d.file("s.toml", "[scnee]\n"), "unknown field 'scnee'; available: "),
    "unknown field": (
        lambda d: d.file("s.toml", "[method]\nbudget = 5\n"),
        "unknown field 'method.budget'; available: ",
    ),
    "wrong type": (lambda d: d.file("s.toml", '[method]\niterations = "many"\n'), "method.iterations = 'many'"),
    "a section that is a number": (lambda d: d.file("s.toml", "method = 3\n"), "method = 3"),
    "zero budget": (lambda d: d.file("s.toml", "[method]\niterations = 0\n"), "greater than or equal to 1"),
    "negative tolerance": (lambda d: d.file("s.toml", "[score]\ntau_m = -0.02\n"), "score.tau_m = -0.02"),
    "NaN": (lambda d: d.file("s.toml", "[score]\ntau_m = nan\n"), "score.tau_m = nan"),
    "infinity": (lambda d: d.file("s.toml", "[physics]\nmass_kg = inf\n"), "physics.mass_kg = inf"),
    "unknown preset": (lambda d: d.file("s.toml", 'preset = "fast"\n'), "preset = 'fast'"),
    "unknown renderer": (lambda d: d.file("s.toml", '[score]\nrenderer = "vulkan"\n'), "score.renderer = 'vulkan'"),
    "unknown method": (lambda d: d.file("s.toml", '[method]\nname = "rirr"\n'), "unknown method 'rirr'; available: "),
    "unknown refiner": (
        lambda d: d.file("s.toml", '[method]\nrefiner = "ipc"\n'),
        "unknown refiner 'ipc'; available: ",
    ),
    "unknown demo": (
        lambda d: d.file("s.toml", '[scene]\ndemo = "teapot"\n'),
        "unknown demo scene 'teapot'; available: ",
    ),
    "terminal codes in a name": (
        lambda d: d.file("s.toml", '[scene]\ndemo = "\\u001b[2J\\nrm"\n'),
        r"unknown demo scene '\x1b[2J\nrm'",
    ),
    "an edited pose of 3 numbers": (
        lambda d: d.file("s.toml", "[[edits]]\nafter_iteration=0\ninstance=0\nhypothesis=0\nT_cam_obj=[0,0,1]\n"),
        "edits.0.T_cam_obj",
    ),
    "a change of another section": (
        lambda d: d.file("s.toml", "[[changes]]\nafter_iteration=1\nsettings={scene={demo='mug'}}\n"),
        "unknown section that can change during a run 'scene'",
    ),
    "no data set": (lambda d: d.file("s.toml", '[scene]\nsource = "bop"\n'), "scene.dataset is empty"),
    "data set is missing": (
        lambda d: d.file("s.toml", '[scene]\nsource = "bop"\ndataset = "../nowhere"\n'),
        "nowhere",
    ),
    "no BOP layout": (
        lambda d: d.file("empty/s.toml", '[scene]\nsource = "bop"\ndataset = "."\n'),
        "empty",
    ),
    "unknown split": (lambda d: d.bop(scene='split = "val"'), "val"),
    "split outside the data set": (lambda d: d.bop(scene='split = "../../.."'), "unknown split '../../..'"),
    "unknown object": (lambda d: d.bop(scene="objects = [99]"), "unknown object 99 in scene.objects; available: 2"),
    "unknown object of a demo": (
        lambda d: d.file("s.toml", '[scene]\ndemo = "bowl"\nobjects = [6, 99]\n'),
        "unknown object 99 in scene.objects; available: 6 (bowl), 10 (block)",
    ),
    "object of no chosen frame": (
        lambda d: _unseen(d, 9),
        "none of the chosen frames (7/3) holds object 9 of scene.objects; objects there: 2 (obj_000002), 5 ",
    ),
    "results of other objects": (
        lambda d: (
            d.file("r.csv", "7,3,77,0.9,1 0 0 0 1 0 0 0 1,0 0 500,-1\n"),
            d.bop(hypotheses='source = "results"\nfiles = ["r.csv"]'),
        )[1],
        "r.csv has no row for an object of the chosen frames: the frames need 2, 5, the rows are of 77; ",
    ),
    "results of other frames": (
        lambda d: (
            d.file("r.csv", "8,3,2,0.9,1 0 0 0 1 0 0 0 1,0 0 500,-1\n"),
            d.bop(hypotheses='source = "results"\nfiles = ["r.csv"]'),
        )[1],
        "r.csv has no row for the chosen frames (7/3), only for 8/3; ",
    ),
    "unknown frame": (lambda d: d.bop(scene='frames = ["7/999"]'), "999"),
    "frame in other words": (lambda d: d.bop(scene='frames = ["7-3"]'), "7-3"),
    "frame outside": (lambda d: d.bop(scene='frames = ["../../etc/passwd"]'), "passwd"),
    "masks of another kind": (lambda d: d.bop(scene='masks = "sam"'), "scene.masks is"),
    "detections missing": (lambda d: d.bop(scene='masks = "none.json"'), "none.json"),
    "detections cut": (
        lambda d: (d.file("cut.json", '[{"scene_id": 7, '), d.bop(scene='masks = "cut.json"'))[1],
        "cut.json",
    ),
    "no results file named": (lambda d: d.bop(hypotheses='source = "results"'), "hypotheses.files is empty"),
    "results missing": (
        lambda d: d.bop(hypotheses='source = "results"\nfiles = ["none.csv"]'),
        "none.csv cannot be read",
    ),
    "a bad line of results": (
        lambda d: (
            d.file("r.csv", "7,3,2,0.9,1 0 0 0 1 0 0 0,0 0 500,-1\n"),
            d.bop(hypotheses='source = "results"\nfiles = ["r.csv"]'),
        )[1],
        "r.csv, line 1: R holds 8 numbers, expected 9",
    ),
    "a mirrored pose": (
        lambda d: (
            d.file("r.csv", "7,3,2,0.9,1 0 0 0 1 0 0 0 -1,0 0 500,-1\n"),
            d.bop(hypotheses='source = "results"\nfiles = ["r.csv"]'),
        )[1],
        "not rigid: det(R) = -1.000",
    ),
    "scene_camera.json damaged": (
        lambda d: _damaged(d, "scene_camera.json"),
        "scene_camera.json",
    ),
}


def _damaged(desk: Desk, name: str) -> Path:
    made = make(desk.folder / "damaged", targets=False)
    (made.scene / name).write_text("{")
    return desk.file("d.toml", '[scene]\nsource = "bop"\ndataset = "damaged"\n')


def _unseen(desk: Desk, obj_id: int) -> Path:
    """Asks for an object that has a model and is in no frame."""
    models = make(desk.folder / "more").root / "models"
    (models / f"obj_{obj_id:06d}.ply").write_bytes((models / "obj_000002.ply").read_bytes())
    scene = f'source = "bop"\ndataset = "more"\nframes = ["7/3"]\nobjects = [{obj_id}]'
    return desk.file("u.toml", f"[scene]\n{scene}\n")


@pytest.mark.parametrize("case", SESSION_FILES)
def test_a_bad_session_is_one_clear_line(desk: Desk, case: str) -> None:
    make_file, expected = SESSION_FILES[case]
    assert expected in desk.batch(make_file(desk))
    assert not (desk.folder / "out").exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--score.alpha", "3"], "score.alpha = 3"),
        (["--method.iterations", "-1"], "method.iterations = -1"),
        (["--physics.steps", "0"], "physics.steps = 0"),
        (["--scene.dataset", "/no/such/data"], "/no/such/data"),
        (["--scene.gravity", "0", "0", "nan"], "scene.gravity = (0.0, 0.0, nan)"),
        (["--scene.gravity", "0", "0", "0"], "a direction cannot be (0, 0, 0)"),
        (["--method.name", "vf"], "unknown method 'vf'; available: "),
        (["--workers", "0"], "--workers is 0, expected 1 or more"),
    ],
)
def test_a_bad_option_is_one_clear_line(desk: Desk, words: list[str], expected: str) -> None:
    assert expected in desk.batch(desk.bop(), *words)


def test_no_session_at_all(desk: Desk) -> None:
    assert "no session file given" in desk.refused("batch", "--out", desk.folder)


def test_two_sessions_of_one_name(desk: Desk) -> None:
    first, second = desk.file("a/s.toml", ""), desk.file("b/s.toml", "")
    assert "two sessions are called 's'" in desk.refused("batch", first, second, "--out", desk.folder / "out")


def test_a_mistake_in_the_last_session_shows_before_the_first_runs(desk: Desk) -> None:
    good, bad = desk.bop(), desk.file("bad.toml", '[method]\nname = "none"\n')
    assert "unknown method" in desk.refused("batch", good, bad, "--out", desk.folder / "out")
    assert not (desk.folder / "out").exists()


# --out


def test_out_is_a_file(desk: Desk) -> None:
    desk.file("out", "precious")
    assert "is a file, expected a folder" in desk.batch(desk.bop())
    assert (desk.folder / "out").read_text() == "precious"


BELOW: dict[str, Callable[[Desk], list[object]]] = {
    "batch": lambda d: ["batch", d.bop(), "--out"],
    "batch of several": lambda d: ["batch", d.bop(), "--methods", "pir", "sir", "--out"],
    "estimate": lambda d: ["estimate", d.bop(), "--hypotheses.source", "ppf", "--out"],
    "study": lambda d: ["study", "ablation", "--quick", "--out"],
    "report": lambda d: ["report", batch_folder(d), "--out"],
    "datasets": lambda d: ["datasets", "fetch", "ycbv", "--folder"],
}


@pytest.mark.parametrize("command", BELOW)
def test_out_is_below_a_file(desk: Desk, command: str) -> None:
    file = desk.file("thing", "precious")
    words = BELOW[command](desk)
    said = desk.refused(*words, file / "out")
    assert said.startswith(f"cannot write to {words[-1]} {file / 'out'}")
    assert said.endswith(f": {file} is a file, not a folder; choose another {words[-1]}")
    assert file.read_text() == "precious"


@pytest.mark.parametrize("command", BELOW)
def test_out_cannot_be_written(desk: Desk, command: str) -> None:
    # /proc refuses even root.
    words = BELOW[command](desk)
    said = desk.refused(*words, "/proc/runs")
    assert said.startswith(f"cannot write to {words[-1]} /proc/runs")
    assert said.endswith(f" in /proc (No such file or directory); choose another {words[-1]}")


@pytest.mark.parametrize("command", ["estimate", "report"])
def test_out_is_a_folder_instead_of_a_file(desk: Desk, command: str) -> None:
    assert "is a folder, expected the name of a file, for example" in desk.refused(*BELOW[command](desk), desk.folder)


def test_out_holds_other_files(desk: Desk) -> None:
    desk.file("out/thesis.tex", "")
    assert "holds other files (thesis.tex) and no batch run" in desk.batch(desk.bop())


def test_out_holds_another_session(desk: Desk) -> None:
    RunFolder(desk.folder / "out", resolve({"method": {"name": "pir"}})).close()
    assert "holds a run of another session: " in desk.batch(desk.bop())


def test_out_holds_a_damaged_session(desk: Desk) -> None:
    desk.file("out/session.toml", "[[[")
    assert "is not TOML" in desk.batch(desk.bop())


def test_out_is_in_use(desk: Desk) -> None:
    folder = RunFolder(desk.folder / "out", resolve({}))
    assert "another batch is writing to" in desk.batch(desk.bop())
    folder.close()


def test_out_holds_a_damaged_run_json(desk: Desk) -> None:
    session = desk.file("demo.toml", "")
    RunFolder(desk.folder / "out", resolve({})).close()
    desk.file("out/run.json", "{")
    assert "run.json cannot be read" in desk.batch(session)


# view


def test_the_port_is_taken(desk: Desk) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert str(port) in desk.refused("view", "--port", port)


@pytest.mark.parametrize("port", ["-1", "65536"])
def test_a_port_that_does_not_exist(desk: Desk, port: str) -> None:
    assert port in desk.refused("view", "--port", port)


@pytest.mark.parametrize("host", ["192.0.2.1", "no.such.host.invalid"])
def test_a_host_that_is_not_this_machine(desk: Desk, host: str) -> None:
    assert host in desk.refused("view", "--host", host, "--port", "0")


def test_view_of_a_missing_session(desk: Desk) -> None:
    assert "does not exist" in desk.refused("view", desk.folder / "none.toml")


def test_view_of_something_that_is_not_there(desk: Desk) -> None:
    expected = "nowhere does not exist; expected a session (.toml), the folder of a batch run, or a recording (.rrd)"
    assert desk.refused("view", desk.folder / "nowhere").endswith(expected)


@pytest.mark.parametrize("other", [False, True])
def test_report_of_what_is_no_folder(desk: Desk, other: bool) -> None:
    words = ["report", batch_folder(desk)] if other else ["report"]
    file, missing = desk.file("thesis.tex", ""), desk.folder / "nowhere"
    assert desk.refused(*words, file) == f"{file} is a file; expected the folder of a batch run, or of several"
    assert (
        desk.refused(*words, missing) == f"{missing} does not exist; expected the folder of a batch run, or of several"
    )


def test_a_file_is_no_data_set(desk: Desk) -> None:
    assert "thesis.tex is a file; give the folder" in desk.refused("datasets", "check", desk.file("thesis.tex", ""))


def test_view_of_a_session_that_cannot_be_opened(desk: Desk) -> None:
    session = desk.file("s.toml", '[scene]\ndemo = "teapot"\n')
    assert "unknown demo scene 'teapot'" in desk.refused("view", session, "--port", "0", "--no-open-browser")


def test_view_of_a_folder_that_is_no_batch(desk: Desk) -> None:
    assert "is no folder of a batch: it has no run.json" in desk.refused("view", desk.folder)


def batch_folder(desk: Desk) -> Path:
    folder = RunFolder(desk.folder / "run", resolve({}))
    folder.write_json("run.json", {"status": "finished"})
    folder.close()
    return desk.folder / "run"


def test_view_of_a_batch_that_was_killed(desk: Desk) -> None:
    assert "frames.csv is not there yet" in desk.refused("view", batch_folder(desk))


@pytest.mark.parametrize("text", ["a,b\n1,2\n", "scene_id,im_id,status\n1,x,ok\n", "scene_id\n1,2,3\n"])
def test_view_of_a_batch_with_a_foreign_table(desk: Desk, text: str) -> None:
    folder = batch_folder(desk)
    (folder / "frames.csv").write_text(text)
    assert "frames.csv is not what a batch writes" in desk.refused("view", folder)


# replay


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "does not exist"),
        (b"", "is empty; expected a recording"),
        (b"PK\x03\x04 not a recording", "is not a rerun recording"),
        (b"RRF2 and then rubbish", ".rrd"),
    ],
)
@pytest.mark.parametrize("verify", [[], ["--verify"]])
def test_files_that_are_no_recordings(desk: Desk, content: bytes | None, expected: str, verify: list[str]) -> None:
    file = desk.folder / "run.rrd"
    if content is not None:
        file.write_bytes(content)
    assert expected in desk.refused("replay", file, *verify)


@pytest.mark.parametrize("verify", [[], ["--verify"]])
def test_a_folder_is_no_recording(desk: Desk, verify: list[str]) -> None:
    said = f"{desk.folder} is a folder, expected a recording (.rrd)"
    assert desk.refused("replay", desk.folder, *verify) == said
    run = batch_folder(desk)
    assert desk.refused("replay", run, *verify).endswith(f"; those of a batch lie in {run / 'recordings'}")


def test_a_recording_of_another_program(desk: Desk) -> None:
    file = desk.folder / "other.rrd"
    rec = rr.RecordingStream("somebody_else")
    rec.save(file)
    rec.log("scalar", rr.Scalars(1.0))
    rec.flush()
    rec.disconnect()
    assert "other.rrd" in desk.refused("replay", file, "--verify")


# As processes of their own


@pytest.mark.parametrize(
    "words",
    [
        ["view", "none.toml"],
        ["batch", "none.toml", "--out", "out"],
        ["replay", "none.rrd"],
        ["replay", "none.rrd", "--verify"],
    ],
)
def test_the_real_program_says_one_line_and_exits_2(words: list[str], tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    program = [sys.executable, "-m", "verefine_viz.cli", *words]
    done = subprocess.run(program, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("verefine-viz: ")
    assert "does not exist" in done.stderr
    assert list(tmp_path.iterdir()) == []
