"""Sessions and options that are wrong: one clear line on stderr, exit code 2, no traceback, nothing half-written."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.bad_input_sessions import BadInput
from tests.scenes.bop_folder import make

MOST = 4 * (os.cpu_count() or 1)
"""Workers."""
Case = tuple[Callable[[BadInput], Path], str]

SESSION_FILES: dict[str, Case] = {
    "missing": (lambda d: d.folder / "none.toml", "none.toml does not exist"),
    "a folder": (lambda d: d.folder, "holds no data that are known; looked for run files"),
    "the folder of a batch": (BadInput.batch_folder, "did you mean "),
    "JSON instead of TOML": (lambda d: d.file("s.toml", '{"scene": {}}'), "is not TOML"),
    "unknown section": (lambda d: d.file("s.toml", "[scnee]\n"), "unknown field 'scnee'; did you mean 'scene'? "),
    "wrong type": (lambda d: d.file("s.toml", '[method]\niterations = "many"\n'), "method.iterations = 'many'"),
    "unknown method": (lambda d: d.file("s.toml", '[method]\nname = "rirr"\n'), "unknown method 'rirr'; did you mean"),
    "terminal codes in a name": (
        lambda d: d.file("s.toml", '[scene]\ndemo = "\\u001b[2J\\nrm"\n'),
        r"unknown demo scene '\x1b[2J\nrm'",
    ),
    "no data set": (lambda d: d.file("s.toml", '[scene]\nsource = "bop"\n'), "scene.dataset is empty"),
    "unknown object": (lambda d: d.bop(scene="objects = [99]"), "unknown object 99 in scene.objects; available: 2"),
    "detections missing": (lambda d: d.bop(scene='masks = "none.json"'), "none.json"),
    "results missing": (
        lambda d: d.bop(hypotheses='source = "results"\nfiles = ["none.csv"]'),
        "none.csv does not exist",
    ),
    "results of other objects": (
        lambda d: d.results("7,3,77,0.9,1 0 0 0 1 0 0 0 1,0 0 500,-1"),
        "r.csv has no row for an object of the chosen frames: the frames need 2, 5, the rows are of 77; ",
    ),
    "scene_camera.json damaged": (lambda d: _damaged(d, "scene_camera.json"), "scene_camera.json"),
}


def _damaged(bad_input: BadInput, name: str) -> Path:
    made = make(bad_input.folder / "damaged", targets=False)
    (made.scene / name).write_text("{")
    return bad_input.file("d.toml", '[scene]\nsource = "bop"\ndataset = "damaged"\n')


@pytest.mark.usefixtures("processes")
def test_a_bad_session_is_one_clear_line(bad_input: BadInput) -> None:
    for case, (make_file, expected) in SESSION_FILES.items():
        assert expected in bad_input.batch(make_file(bad_input)), case
        assert not (bad_input.folder / "out").exists(), case


@pytest.mark.usefixtures("processes")
def test_a_bad_option_is_one_clear_line(bad_input: BadInput) -> None:
    options = {
        "--score.alpha 3": "score.alpha = 3",
        "--scene.demo bowl": 'command line: scene.demo is set, but scene.source is "bop"',
        "--scene.gravity 0 0 nan": "scene.gravity.2 = nan: expected a number from -1000000 to 1000000",
        f"--workers {MOST + 1}": f"--workers is {MOST + 1}, expected {MOST} or fewer, 4 for each core",
    }
    for words, expected in options.items():
        assert expected in bad_input.batch(bad_input.bop(), *words.split()), words


def test_no_session_at_all(bad_input: BadInput) -> None:
    assert "no session given" in bad_input.refused("batch", "--out", bad_input.folder)


def test_a_mistake_in_the_last_session_shows_before_the_first_runs(bad_input: BadInput) -> None:
    good, bad = bad_input.bop(), bad_input.file("bad.toml", '[method]\nname = "none"\n')
    assert "unknown method" in bad_input.refused("batch", good, bad, "--out", bad_input.folder / "out")
    assert not (bad_input.folder / "out").exists()
