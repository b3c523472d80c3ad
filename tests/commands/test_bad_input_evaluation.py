"""Bad results, targets, data sets and clusters at the command line: one clear line, exit code 2, nothing half-written.

Full disks have a file of their own: tests/batch/test_full_disk.py.
"""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import pytest

from tests.batch import answering
from tests.cli.command_line import CommandLine
from tests.scenes.bop_folder import make
from verefine_viz import cli
from verefine_viz.batch import cluster as scheduler
from verefine_viz.batch import worker_pool as pool
from verefine_viz.commands.dataset_parts import splits_of
from verefine_viz.scenes.results_csv import HEADER

POSE = "1 0 0 0 1 0 0 0 1,0 0 500"
ROW = f"7,3,5,1,{POSE},-1"
GOOD = f"{HEADER}\n{ROW}\n7,3,2,1,{POSE},-1\n"
TARGETS = "test_targets_bop19.json"


class BadInput(CommandLine):
    """A data set, and what the command line says."""

    def refused(self, *words: object) -> str:
        """The one line with which these words are refused; they leave no trace."""
        before = sorted(self.folder.rglob("*"))
        line = super().refused(*words)
        assert sorted(self.folder.rglob("*")) == before
        return line

    def evaluated(self, results: Path, *words: object) -> tuple[str, ...]:
        """How ``evaluate`` is called on the data set."""
        return ("evaluate", str(results), "--dataset", str(self.made.root), *map(str, words))

    def batch(self, *scene_and_hypotheses: str) -> tuple[str, ...]:
        """How ``batch`` is called on the data set."""
        named = ("--scene.source", "bop", "--scene.dataset", str(self.made.root), *scene_and_hypotheses)
        return ("batch", str(self.session()), "--out", str(self.folder / "out"), *named)

    def session(self) -> Path:
        path = self.folder / "session.toml"
        if not path.exists():
            path.write_text("")
        return path


@pytest.fixture
def bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> BadInput:
    monkeypatch.setattr(pool, "work", answering.work)
    found = BadInput(tmp_path, make(tmp_path / "boxes"), capsys)
    found.session()
    return found


@pytest.mark.usefixtures("processes")
def test_a_results_file_that_breaks_the_format(bad_input: BadInput) -> None:
    for content, words in ((GOOD.encode("utf-16"), "no text file"), (f"\n{ROW[:-3]}", "line 1: found a blank line")):
        path = bad_input.file("bad_boxes-test.csv", content)
        line = bad_input.refused(*bad_input.evaluated(path))
        assert line.startswith(f"{path}: {words}")
        # Where it is to be the initial poses of a batch, it is refused in the same words, before the folder is made.
        hypotheses = ("--hypotheses.source", "results", "--hypotheses.files", str(path))
        assert bad_input.refused(*bad_input.batch(*hypotheses)) == line


# Targets files


BAD_TARGETS: tuple[tuple[dict[str, Any], str], ...] = (
    ({"inst_count": 0}, "mine.json asks for no instance: every 'inst_count' is 0, expected 1 or more somewhere"),
    ({"inst_count": -1}, "mine.json: entry 0: Expected `int` >= 0 (at $.inst_count)"),
)


def test_a_targets_file_that_cannot_be_used(bad_input: BadInput) -> None:
    entries = json.loads((bad_input.made.root / TARGETS).read_text())
    results = bad_input.file("a.csv", GOOD)
    for change, words in BAD_TARGETS:
        targets = bad_input.file("mine.json", json.dumps([entry | change for entry in entries]))
        assert words in bad_input.refused(*bad_input.evaluated(results, "--targets", targets))
    targets = bad_input.file("mine.json", "[]")
    assert "mine.json lists no targets" in bad_input.refused(*bad_input.evaluated(results, "--targets", targets))


def test_targets_that_ask_for_what_is_not_there(bad_input: BadInput) -> None:
    entries = json.loads((bad_input.made.root / TARGETS).read_text())
    targets = bad_input.file("mine.json", json.dumps([*entries, {**entries[0], "obj_id": 77, "inst_count": 2}]))
    assert cli.main([*bad_input.evaluated(bad_input.file("a.csv", GOOD), "--targets", targets)]) == 0
    said = bad_input.capsys.readouterr().out
    assert "mine.json asks for 5 instances, of which ground truth holds 3; the others do not count" in said
    about_it = bad_input.file("b.csv", f"7,3,77,1,{POSE},-1\n")
    assert "unknown model 77; available: 2, 5" in bad_input.refused(
        *bad_input.evaluated(about_it, "--targets", targets)
    )


# Data sets


def test_without_ground_truth_there_is_nothing_to_score(bad_input: BadInput) -> None:
    (bad_input.made.scene / "scene_gt.json").unlink()
    line = bad_input.refused(*bad_input.evaluated(bad_input.file("a.csv", GOOD)))
    assert "scene_gt.json is missing; without ground truth there is nothing to score" in line


def test_a_folder_that_is_no_data_set(bad_input: BadInput) -> None:
    assert "does not exist" in bad_input.refused("datasets", "check", bad_input.folder / "none")
    assert "holds no split with scenes; expected for example" in bad_input.refused(
        "datasets", "check", bad_input.made.scene / "rgb"
    )
    split = bad_input.made.scene.parent
    (bad_input.made.scene / "scene_camera.json").unlink()
    assert f"a split itself: name the data set's folder, {bad_input.made.root.resolve()}" in bad_input.refused(
        "datasets", "check", split
    )
    assert f"did you mean {bad_input.made.root}?" in bad_input.refused("datasets", "check", bad_input.folder)
    assert splits_of(bad_input.made.root) == ("test",)


# Clusters


def test_what_is_no_address_of_a_cluster(bad_input: BadInput) -> None:
    for address in ("foo", "tcp://host:port"):
        line = bad_input.refused(*bad_input.batch("--cluster", address))
        assert line.startswith(f"--cluster {address} is no address; expected tcp://HOST:PORT")


@pytest.mark.usefixtures("processes")
def test_something_that_listens_and_says_nothing(bad_input: BadInput, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduler, "CONNECT_S", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        line = bad_input.refused(*bad_input.batch("--cluster", address))
    assert f"no Dask scheduler answers at {address} (no answer for 0.5 s)" in line
