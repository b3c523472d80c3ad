"""What the command line refuses: one line on stderr that names what is wrong, exit code 2, nothing written.

What settings refuse is in tests/run/test_session_file.py, what tyro cannot read in tests/cli/test_cli.py.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
import rerun as rr

from tests.batch import fragile
from tests.batch.frames import PoolHere
from tests.cli.command_line import CommandLine
from tests.made_runs import answer, finished, written
from tests.page.recorded import SESSION, record
from tests.scenes.bop_folder import Made, make
from verefine_viz.batch import cluster as scheduler
from verefine_viz.batch import worker_pool as pool
from verefine_viz.batch.folder import RunFolder
from verefine_viz.run.session_file import resolve
from verefine_viz.scenes.results_csv import HEADER
from verefine_viz.studies import run_study

pytestmark = pytest.mark.usefixtures("processes")
ROOT = Path(__file__).resolve().parents[2]
POSE = "1 0 0 0 1 0 0 0 1,0 0 500"
ROW = f"7,3,5,1,{POSE},-1"
MOST_WORKERS = 4 * (os.cpu_count() or 1)


class BadInput(CommandLine):
    """Sessions on a made-up data set, and batches of them."""

    def bop(self, scene: str = "", hypotheses: str = "") -> Path:
        """A session on the made-up data set."""
        text = f'[scene]\nsource = "bop"\ndataset = {json.dumps(str(self.made.root))}\n{scene}\n'
        return self.file("session.toml", f"{text}[hypotheses]\n{hypotheses}\n")

    def results(self, row: str) -> Path:
        """A session whose initial poses are a results file of one row."""
        self.file("r.csv", f"{row}\n")
        return self.bop(hypotheses='source = "results"\nfiles = ["r.csv"]')

    def evaluate(self, *words: object) -> tuple[object, ...]:
        return ("evaluate", *words, "--dataset", self.made.root)

    def batch_folder(self) -> Path:
        """The folder of a batch that lacks its tables."""
        folder = RunFolder(self.folder / "run", resolve({}))
        folder.write_json("run.json", {"status": "finished"})
        folder.close()
        return self.folder / "run"


Words = Callable[[BadInput], Iterable[object]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make(tmp_path_factory.mktemp("data"))


@pytest.fixture
def bad_input(
    tmp_path: Path, made: Made, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> BadInput:
    # Bad input must be refused before the first frame is solved; a real worker would only cost time.
    monkeypatch.setattr(pool, "work", fragile.work)
    return BadInput(tmp_path, made, capsys)


def damaged_camera(d: BadInput) -> Path:
    made = make(d.folder / "damaged", targets=False)
    (made.scene / "scene_camera.json").write_text("{")
    return d.file("d.toml", '[scene]\nsource = "bop"\ndataset = "damaged"\n')


def recording_of_another_program(d: BadInput) -> Path:
    rec = rr.RecordingStream("somebody_else")
    rec.save(d.folder / "other.rrd")
    rec.log("scalar", rr.Scalars(1.0))
    rec.flush()
    rec.disconnect()
    return d.folder / "other.rrd"


def frames_to_watch(d: BadInput) -> Path:
    """A folder of runs, below one of a batch."""
    written(d.folder / "batch", finished("1/0", [answer(1, 0)]))
    d.file("batch/run.json", "{}")
    return d.folder / "batch"


def targets(d: BadInput, **change: int) -> Path:
    entries = json.loads((d.made.root / "test_targets_bop19.json").read_text())
    return d.file("mine.json", json.dumps([entry | change for entry in entries] if change else []))


def folder_with_dataset(d: BadInput) -> Path:
    """A folder that holds the data set, and a folder that looks like a split."""
    above = d.folder / "datasets"
    (above / "photos" / "2024").mkdir(parents=True)
    (above / "boxes").symlink_to(d.made.root, target_is_directory=True)
    return above


BATCH: dict[str, Words] = {
    "none.toml": lambda d: [d.folder / "none.toml"],
    "holds no data": lambda d: [d.folder],
    "did you mean": lambda d: [d.batch_folder()],
    r"'\x1b[2J\nrm'": lambda d: [d.file("s.toml", '[scene]\ndemo = "\\u001b[2J\\nrm"\n')],
    "scene.dataset": lambda d: [d.file("s.toml", '[scene]\nsource = "bop"\n')],
    "scene.objects": lambda d: [d.bop(scene="objects = [99]")],
    "none.json": lambda d: [d.bop(scene='masks = "none.json"')],
    "none.csv": lambda d: [d.bop(hypotheses='source = "results"\nfiles = ["none.csv"]')],
    "r.csv has no row": lambda d: [d.results(f"7,3,77,0.9,{POSE},-1")],
    "r.csv: line 1": lambda d: [d.results(f"\n{ROW[:-3]}")],
    "scene_camera.json": lambda d: [damaged_camera(d)],
    "--workers": lambda d: [d.bop(), "--workers", MOST_WORKERS + 1],
    "--cluster foo": lambda d: [d.bop(), "--cluster", "foo"],
    "--cluster tcp://host:port": lambda d: [d.bop(), "--cluster", "tcp://host:port"],
    "'none'": lambda d: [d.bop(), d.file("bad.toml", '[method]\nname = "none"\n')],
    "no session": lambda d: [],
}
"""Words of ``batch``, by what the line names."""


@pytest.mark.parametrize("named", BATCH)
def test_a_batch_that_cannot_begin(bad_input: BadInput, named: str) -> None:
    words = [*BATCH[named](bad_input)]
    assert named in bad_input.refused("batch", *words, "--out", bad_input.folder / "out")


VIEW = ("view", "--port", "0", "--no-open-browser")
OTHERS: dict[str, Words] = {
    "'nope'": lambda d: [*VIEW, "--scene.demo", "nope"],
    "'ipc'; did you mean 'icp'?": lambda d: [*VIEW, "--method.refiner", "ipc"],
    "localhost:3000": lambda d: [*VIEW, "--allow-origin", "localhost:3000"],
    "no.such.host.invalid": lambda d: [*VIEW, "--host", "no.such.host.invalid"],
    "192.0.2.1": lambda d: [*VIEW, "--host", "192.0.2.1"],
    r"a\udcff": lambda d: [*VIEW, "--host", "a\udcff"],
    "65536": lambda d: ["view", "--port", "65536"],
    "poses.csv does not exist": lambda d: [*VIEW, "poses.csv"],
    "README.md": lambda d: [*VIEW, ROOT / "README.md"],
    "is no folder of a batch": lambda d: [*VIEW, d.folder],
    "a/session.toml": lambda d: [*VIEW, d.file("a/session.toml", "").parent],
    "has no finished frame": lambda d: [*VIEW, d.batch_folder()],
    "report RUN_A RUN_B": lambda d: [*VIEW, d.batch_folder(), d.folder / "run"],
    "elsewhere.rrd": lambda d: [
        *VIEW,
        record(d.folder / "one.rrd", SESSION),
        record(d.folder / "elsewhere.rrd", SESSION, frame="0/1"),
    ],
    "--watch nowhere": lambda d: [*VIEW, "--watch", "nowhere"],
    "a.rrd is no session": lambda d: [*VIEW, "a.rrd", "--watch", d.folder],
    "--out": lambda d: [*VIEW, "--out", "runs"],
    "'best'": lambda d: [*VIEW, "--watch", d.folder, "--method.name", "best"],
    "batch holds runs": lambda d: [*VIEW, "--watch", frames_to_watch(d)],
    "batch/runs holds runs": lambda d: [*VIEW, "--watch", frames_to_watch(d) / "runs"],
    "run.rrd does not exist": lambda d: ["replay", d.folder / "run.rrd", "--verify"],
    "empty.rrd is empty": lambda d: ["replay", d.file("empty.rrd", ""), "--verify"],
    "zip.rrd": lambda d: ["replay", d.file("zip.rrd", b"PK\x03\x04 not a recording")],
    "rubbish.rrd": lambda d: ["replay", d.file("rubbish.rrd", b"RRF2 and then rubbish"), "--verify"],
    "other.rrd": lambda d: ["replay", recording_of_another_program(d), "--verify"],
    "run/runs": lambda d: ["replay", d.batch_folder()],
    "2 recordings": lambda d: ["replay", d.file("a.rrd"), d.file("b.rrd")],
    ".gif": lambda d: ["film", ROOT / "sessions" / "mug.toml", "--out", d.folder / "run.jpg"],
    "thesis.tex is a file": lambda d: ["report", d.file("thesis.tex", "")],
    "nowhere does not exist": lambda d: ["report", d.batch_folder(), d.folder / "nowhere"],
    "--embed is -1": lambda d: ["report", d.folder, "--embed", "-1"],
    "--pictures is 10001": lambda d: ["report", d.folder, "--pictures", "10001"],
    "a.tex is a file": lambda d: ["datasets", "check", d.file("a.tex", "")],
    "none does not exist": lambda d: ["datasets", "check", d.folder / "none"],
    "holds no split": lambda d: ["datasets", "check", d.made.scene / "rgb"],
    "boxes?": lambda d: ["datasets", "check", folder_with_dataset(d)],
    "'tless'": lambda d: ["datasets", "fetch", "tless"],
    "net.pth": lambda d: ["train", "depth_net", "--out", "net.pth"],
    "--minutes": lambda d: ["train", "depth_net", "--out", "net.onnx", "--minutes", "nan"],
    "--steps": lambda d: ["train", "depth_net", "--out", "net.onnx", "--steps", "0"],
    "--dataset is": lambda d: ["train", "depth_net", "--out", "net.onnx", "--dataset", "lm"],
    "--points": lambda d: ["train", "densefusion", "--out", "net.onnx", "--points", "1"],
    "--split": lambda d: ["train", "densefusion", "--out", "net.onnx", "--split", "train_pbr"],
    "'perturb'": lambda d: ["estimate", d.bop(), "--out", d.folder / "pool.csv"],
    "a.csv: no text": lambda d: d.evaluate(d.file("a.csv", f"{HEADER}\n{ROW}\n".encode("utf-16"))),
    "no.csv": lambda d: d.evaluate(d.folder / "no.csv"),
    "no results file given": lambda d: d.evaluate(),
    "scene_camera.json is no results": lambda d: d.evaluate(d.made.scene / "scene_camera.json"),
    "inst_count": lambda d: d.evaluate(d.file("a.csv", ROW), "--targets", targets(d, inst_count=0)),
    "entry 0": lambda d: d.evaluate(d.file("a.csv", ROW), "--targets", targets(d, inst_count=-1)),
    "mine.json lists no targets": lambda d: d.evaluate(d.file("a.csv", ROW), "--targets", targets(d)),
    "scene 99": lambda d: d.evaluate(d.file("a.csv", f"99,3,5,1,{POSE},-1")),
    "image 4": lambda d: d.evaluate(d.file("a.csv", f"7,4,5,1,{POSE},-1")),
    "object 9": lambda d: d.evaluate(d.file("a.csv", f"7,3,9,1,{POSE},-1")),
    "'train'": lambda d: d.evaluate(d.file("a.csv", ROW), "--split", "train"),
    "no.json": lambda d: d.evaluate(d.file("a.csv", ROW), "--targets", "no.json"),
    "--workers is 0": lambda d: d.evaluate(d.file("a.csv", ROW), "--workers", "0"),
    "nowhere": lambda d: ["evaluate", d.file("a.csv", ROW), "--dataset", d.folder / "nowhere"],
}
"""Words of other commands, by what the line names."""


@pytest.mark.parametrize("named", OTHERS)
def test_a_command_that_cannot_begin(bad_input: BadInput, named: str) -> None:
    assert named in bad_input.refused(*OTHERS[named](bad_input))


OUT: dict[str, Words] = {
    "batch": lambda d: ["batch", d.bop(), "--out"],
    "batch of several": lambda d: ["batch", d.bop(), "--methods", "pir", "sir", "--out"],
    "estimate": lambda d: ["estimate", d.bop(), "--hypotheses.source", "ppf", "--out"],
    "study": lambda d: ["study", "ablation", "--quick", "--out"],
    "report": lambda d: ["report", d.batch_folder(), "--out"],
    "datasets": lambda d: ["datasets", "fetch", "ycbv", "--folder"],
}


@pytest.mark.parametrize("command", OUT)
def test_places_that_cannot_be_written_to(bad_input: BadInput, command: str) -> None:
    words, file = [*OUT[command](bad_input)], bad_input.file("thing", "precious")
    assert f"{file} is a file" in bad_input.refused(*words, file / "out")
    assert file.read_text() == "precious"
    if command in ("estimate", "report"):
        assert "is a folder" in bad_input.refused(*words, bad_input.folder)
    if command in ("batch", "batch of several", "estimate"):
        among = bad_input.made.root / "test" / "000007" / "run" / "new.csv"
        assert str(bad_input.made.root / "test") in bad_input.refused(*words, among)
        assert not among.parent.exists()
    if command == "batch":
        assert "File name too long" in bad_input.refused(*words, bad_input.folder / ("n" * 300))
        assert str(bad_input.file("out/session.toml", "[[[")) in bad_input.refused(
            *words, bad_input.folder / "out", leaves=("out",)
        )


def test_the_home_folder_that_a_shell_left_alone(bad_input: BadInput, monkeypatch: pytest.MonkeyPatch) -> None:
    bad_input.file("runs/thesis.tex", "")
    monkeypatch.setenv("HOME", str(bad_input.folder))
    bad_input.bop()
    assert str(bad_input.folder / "runs") in bad_input.refused("batch", "~/session.toml", "--out=~/runs")


def test_the_port_is_taken_and_make_takes_another(bad_input: BadInput) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert str(port) in bad_input.refused("view", "--port", port)
    # Within another make, it tells of folders as well.
    command = ["make", "-n", "--no-print-directory", "app", "PORT=1234"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.splitlines()[-1].endswith("app.py sessions/mug.toml --port 1234")


def test_something_that_listens_and_says_nothing(bad_input: BadInput, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduler, "CONNECT_S", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        line = bad_input.refused("batch", bad_input.bop(), "--out", bad_input.folder / "out", "--cluster", address)
    assert address in line


GRASPED: dict[str, Words] = {
    "notes.xml": lambda d: [
        "--scene.source",
        "layout",
        "--scene.dataset",
        d.made.root,
        "--scene.layout",
        d.file("notes.xml", "banana"),
    ],
    "none is no folder": lambda d: ["--scene.demo", "duck", "--grasp.folder", d.folder / "none"],
    "frame 0/0": lambda d: ["--scene.demo", "duck", "--grasp.opening-m", "0.02"],
}


@pytest.mark.parametrize("named", GRASPED)
def test_what_cannot_be_grasped(bad_input: BadInput, named: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_study, "Pool", PoolHere)
    words = [*GRASPED[named](bad_input), "--workers", "1", "--out", bad_input.folder / "out"]
    assert named in bad_input.refused("study", "grasping", *words, leaves=("out",))
