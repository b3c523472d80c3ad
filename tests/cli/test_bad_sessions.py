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
    "a folder": (lambda d: d.folder, "cannot be read: it is a folder, expected a .toml file"),
    "the folder of a batch": (BadInput.batch_folder, "did you mean "),
    "not TOML": (lambda d: d.file("s.toml", "[scene\n"), "is not TOML"),
    "JSON instead of TOML": (lambda d: d.file("s.toml", '{"scene": {}}'), "is not TOML"),
    "not text": (lambda d: d.file("s.toml", b"\xff\xfe\x00"), "cannot be read: it is no text, expected a .toml file"),
    "unknown section": (lambda d: d.file("s.toml", "[scnee]\n"), "unknown field 'scnee'; did you mean 'scene'? "),
    "unknown field": (
        lambda d: d.file("s.toml", "[method]\nbudget = 5\n"),
        "unknown field 'method.budget'; available: ",
    ),
    "wrong type": (lambda d: d.file("s.toml", '[method]\niterations = "many"\n'), "method.iterations = 'many'"),
    "empty": (lambda d: d.file("s.toml", "\n"), "s.toml is empty, expected at least a [scene]"),
    "results files that no source reads": (
        lambda d: d.bop(hypotheses='files = ["r.csv"]'),
        'session.toml: hypotheses.files is set, but hypotheses.source is "perturb" and does not read it; '
        'set hypotheses.source = "results", or leave hypotheses.files out',
    ),
    "a data set that no source reads": (
        lambda d: d.file("s.toml", '[scene]\ndataset = "data"\n'),
        's.toml: scene.dataset is set, but scene.source is "demo" and does not read it; set scene.source = "bop"',
    ),
    "a section that is a number": (lambda d: d.file("s.toml", "method = 3\n"), "method = 3"),
    "zero budget": (lambda d: d.file("s.toml", "[method]\niterations = 0\n"), "greater than or equal to 1"),
    "negative tolerance": (lambda d: d.file("s.toml", "[score]\ntau_m = -0.02\n"), "score.tau_m = -0.02"),
    "NaN": (lambda d: d.file("s.toml", "[score]\ntau_m = nan\n"), "score.tau_m = nan"),
    "infinity": (lambda d: d.file("s.toml", "[physics]\nmass_kg = inf\n"), "physics.mass_kg = inf"),
    "unknown preset": (lambda d: d.file("s.toml", 'preset = "fast"\n'), "preset = 'fast'"),
    "unknown renderer": (lambda d: d.file("s.toml", '[score]\nrenderer = "vulkan"\n'), "score.renderer = 'vulkan'"),
    "unknown method": (lambda d: d.file("s.toml", '[method]\nname = "rirr"\n'), "unknown method 'rirr'; did you mean"),
    "unknown refiner": (
        lambda d: d.file("s.toml", '[method]\nrefiner = "ipc"\n'),
        "unknown refiner 'ipc'; did you mean 'icp'? available: ",
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
        lambda d: d.results("7,3,77,0.9,1 0 0 0 1 0 0 0 1,0 0 500,-1"),
        "r.csv has no row for an object of the chosen frames: the frames need 2, 5, the rows are of 77; ",
    ),
    "results of other frames": (
        lambda d: d.results("8,3,2,0.9,1 0 0 0 1 0 0 0 1,0 0 500,-1"),
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
        "none.csv does not exist",
    ),
    "a bad line of results": (
        lambda d: d.results("7,3,2,0.9,1 0 0 0 1 0 0 0,0 0 500,-1"),
        "r.csv, line 1: R holds 8 numbers, expected 9",
    ),
    "a header in other letters": (
        lambda d: d.results("Scene_ID,Im_ID,Obj_ID,Score,R,t,Time"),
        "r.csv, line 1: the header is 'Scene_ID,Im_ID,Obj_ID,Score,R,t,Time', expected scene_id,im_id,obj_id,score,",
    ),
    "a header with other commas": (
        lambda d: d.results("scene_id;im_id;obj_id;score;R;t;time"),
        "r.csv, line 1: the header is 'scene_id;im_id;obj_id;score;R;t;time', expected ",
    ),
    "a mirrored pose": (
        lambda d: d.results("7,3,2,0.9,1 0 0 0 1 0 0 0 -1,0 0 500,-1"),
        "not rigid: det(R) = -1.000",
    ),
    "scene_camera.json damaged": (
        lambda d: _damaged(d, "scene_camera.json"),
        "scene_camera.json",
    ),
}


def _damaged(bad_input: BadInput, name: str) -> Path:
    made = make(bad_input.folder / "damaged", targets=False)
    (made.scene / name).write_text("{")
    return bad_input.file("d.toml", '[scene]\nsource = "bop"\ndataset = "damaged"\n')


def _unseen(bad_input: BadInput, obj_id: int) -> Path:
    """Asks for an object that has a model and is in no frame."""
    models = make(bad_input.folder / "more").root / "models"
    (models / f"obj_{obj_id:06d}.ply").write_bytes((models / "obj_000002.ply").read_bytes())
    scene = f'source = "bop"\ndataset = "more"\nframes = ["7/3"]\nobjects = [{obj_id}]'
    return bad_input.file("u.toml", f"[scene]\n{scene}\n")


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("case", SESSION_FILES)
def test_a_bad_session_is_one_clear_line(bad_input: BadInput, case: str) -> None:
    make_file, expected = SESSION_FILES[case]
    assert expected in bad_input.batch(make_file(bad_input))
    assert not (bad_input.folder / "out").exists()


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--score.alpha", "3"], "score.alpha = 3"),
        (["--method.iterations", "-1"], "command line: method.iterations = -1"),
        (["--scene.demo", "bowl"], 'command line: scene.demo is set, but scene.source is "bop"'),
        (["--physics.steps", "0"], "physics.steps = 0"),
        (["--scene.dataset", "/no/such/data"], "/no/such/data"),
        (["--scene.gravity", "0", "0", "nan"], "scene.gravity = (0.0, 0.0, nan)"),
        (["--scene.gravity", "0", "0", "0"], "a direction cannot be (0, 0, 0)"),
        (["--method.name", "vf"], "unknown method 'vf'; available: "),
        (["--workers", "0"], "--workers is 0, expected 1 or more"),
        (["--workers", str(MOST + 1)], f"--workers is {MOST + 1}, expected {MOST} or fewer, 4 for each core"),
    ],
)
def test_a_bad_option_is_one_clear_line(bad_input: BadInput, words: list[str], expected: str) -> None:
    assert expected in bad_input.batch(bad_input.bop(), *words)


def test_no_session_at_all(bad_input: BadInput) -> None:
    assert "no session file given" in bad_input.refused("batch", "--out", bad_input.folder)


def test_two_sessions_of_one_name(bad_input: BadInput) -> None:
    first, second = bad_input.file("a/s.toml", ""), bad_input.file("b/s.toml", "")
    assert "two sessions are called 's'" in bad_input.refused("batch", first, second, "--out", bad_input.folder / "out")


def test_a_mistake_in_the_last_session_shows_before_the_first_runs(bad_input: BadInput) -> None:
    good, bad = bad_input.bop(), bad_input.file("bad.toml", '[method]\nname = "none"\n')
    assert "unknown method" in bad_input.refused("batch", good, bad, "--out", bad_input.folder / "out")
    assert not (bad_input.folder / "out").exists()
