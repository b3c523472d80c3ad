"""The labels of a folder while they are made: on the disk at once, held by one program, safe from kills."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.full_disk import file_limit
from tests.labels.labelled import label
from verefine_viz.core.errors import InputError
from verefine_viz.labels import label_folder
from verefine_viz.labels.label_folder import LabelFolder, folder_of_labels
from verefine_viz.scenes.labels import LABELS, read_labels

ROOT = Path(__file__).resolve().parents[2]
HERE = np.eye(4)


def numbers(folder: Path) -> dict[str, list[int]]:
    return {frame: [one.instance for one in of] for frame, of in read_labels(folder / LABELS).items()}


def test_every_change_is_on_the_disk_and_numbers_are_not_used_again(tmp_path: Path) -> None:
    with LabelFolder(tmp_path / "new") as labels:
        for frame in ("1/2", "1/10"):
            assert labels.next_instance(frame) == 0
            labels.put(frame, label(0, 5, HERE))
        labels.put("1/2", label(labels.next_instance("1/2"), 6, HERE))
        assert numbers(tmp_path / "new") == {"1/2": [0, 1], "1/10": [0]}
        labels.put("1/2", label(0, 5, HERE, "uncertain"))
        assert [one.state for one in read_labels(labels.path)["1/2"]] == ["uncertain", "accepted"]
        labels.remove("1/2", 1)
        labels.remove("1/10", 0)
        labels.mark_empty("1/3")
        assert numbers(tmp_path / "new") == {"1/2": [0], "1/3": []}
        assert labels.next_instance("1/2") == 2
        labels.mark_empty("1/3", is_empty=False)
        with pytest.raises(InputError, match="has 1 labels; remove them first"):
            labels.mark_empty("1/2")
        with pytest.raises(InputError, match="has no label of instance 7"):
            labels.remove("1/2", 7)
    with LabelFolder(tmp_path / "new") as labels:
        assert {frame: len(of) for frame, of in labels.frames.items()} == {"1/2": 1}
        assert labels.next_instance("1/2") == 1


def test_a_label_that_cannot_be_written_is_not_there(tmp_path: Path) -> None:
    with LabelFolder(tmp_path) as labels:
        labels.put("1/1", label(0, 5, HERE))
        before = labels.path.read_bytes()
        with file_limit(len(before) + 10), pytest.raises(InputError, match="cannot write"):
            labels.put("1/1", label(1, 5, HERE))
        assert [one.instance for one in labels.labels("1/1")] == [0]
        assert labels.path.read_bytes() == before
        assert labels.next_instance("1/1") == 1


@pytest.mark.usefixtures("processes")
def test_a_killed_program_leaves_all_its_labels_and_another_one_is_named(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.labels.labelled", str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        next(process.stdout)
        with pytest.raises(InputError) as refused:
            LabelFolder(tmp_path)
        last = next(int(line) for line in process.stdout if int(line) > 130)
        process.kill()
        last = max([last, *map(int, process.stdout.read().split())])
    assert f"process {process.pid} on " in str(refused.value)
    assert "\n" not in str(refused.value)
    with LabelFolder(tmp_path) as labels:
        assert sum(map(len, labels.frames.values())) in (last, last + 1)
        assert sorted(path.name for path in tmp_path.iterdir()) == [".labels.lock", LABELS]


@pytest.mark.parametrize(
    "content",
    [
        "",
        '{"version": 1, "frames": {"1/1": [',
        '{"version": 2, "frames": {}}',
        '{"version": 1, "frames": {"one": []}}',
        json.dumps({"version": 1, "frames": {"1/1": [{"instance": 0, "obj_id": 1, "name": "a", "light": "green",
                                                      "T_cam_obj": [0.0] * 16}]}}),
    ],
)  # fmt: skip
def test_a_damaged_file_is_one_line_and_stays(tmp_path: Path, content: str) -> None:
    (tmp_path / LABELS).write_text(content)
    for _ in range(2):  # The lock is released.
        with pytest.raises(InputError) as refused:
            LabelFolder(tmp_path)
        assert str(tmp_path / LABELS) in str(refused.value)
        assert "\n" not in str(refused.value)
    assert (tmp_path / LABELS).read_text() == content


@dataclass
class ReadOnly:
    """A disk on which nothing can be written to some folder."""

    folder: Path

    def check(self, path: Path) -> None:
        if path == self.folder:
            raise InputError(f"cannot write to {path}")


def test_labels_are_in_the_folder_or_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "frames").mkdir()
    assert folder_of_labels(tmp_path / "frames") == tmp_path / "frames"
    monkeypatch.setattr(label_folder, "check_folder", ReadOnly(tmp_path / "frames").check)
    assert folder_of_labels(tmp_path / "frames") == tmp_path / "frames-labels"
