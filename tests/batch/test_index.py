"""A batch folder read again: what comes first."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from verefine_viz.batch.folder import RunFolder
from verefine_viz.batch.index import (
    BatchIndex,
    Order,
    RunSelection,
    find_runs,
    is_batch_folder,
    named_runs,
    read_batch,
)
from verefine_viz.batch.journal import BatchInfo

# NAMES FrameResult,Answer,failed_frame,write_frames_csv
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.run.session_file import resolve

SESSION = resolve({"title": "t"})


def row(im_id: int, **values: object) -> Answer:
    return Answer.model_validate({"scene_id": 1, "im_id": im_id, "status": "ok", "diameter_mm": 100.0, **values})


ROWS = (
    row(1, add_s_mm=5.0, score=0.9, name="mug"),
    row(2, add_s_mm=30.0, score=0.8, cause="pool"),
    row(3, score=0.3),
    row(4, status="no_answer"),
    row(6, add_s_mm=30.0, diameter_mm=1000.0, score=0.1),
)


@pytest.fixture
def index(tmp_path: Path) -> BatchIndex:
    folder = RunFolder(tmp_path, SESSION)
    results = [FrameResult(frame=f"1/{r.im_id}", failed=False, seconds=1.0, objects=(r,)) for r in ROWS]
    write_frames_csv(tmp_path / "frames.csv", [*results, failed_frame("1/5", "no depth")])
    folder.write_json("run.json", {"status": "finished"})
    folder.close()
    assert is_batch_folder(tmp_path)
    return read_batch(tmp_path)


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ("error", [5, 4, 2, 1, 6, 3]),
        ("score", [5, 4, 6, 3, 2, 1]),
        ("misleading", [2, 1, 3, 6, 4, 5]),
        ("cause", [2, 5, 4, 1, 6, 3]),
        ("object", [5, 4, 2, 6, 3, 1]),
        ("frame", [1, 2, 3, 4, 6, 5]),
        ("time", [1, 2, 3, 4, 6, 5]),
        ("undetermined", [1, 2, 3, 4, 6, 5]),
    ],
)
def test_the_worst_come_first(index: BatchIndex, order: Order, expected: list[int]) -> None:
    assert [r.im_id for r in index.sorted_by(order)] == expected


def test_frames_that_can_be_opened_come_before_failed_ones(index: BatchIndex) -> None:
    assert index.frames == ("1/4", "1/2", "1/1", "1/6", "1/3", "1/5")
    assert index.session == SESSION
    assert index.run == BatchInfo(status="finished")


def test_a_table_that_lost_rows_since_it_was_counted_is_refused(tmp_path: Path, index: BatchIndex) -> None:
    run = {"status": "finished", "totals": {"frames": 6, "objects": 5}}
    (tmp_path / "run.json").write_text(json.dumps(run))
    assert read_batch(tmp_path).rows == index.rows  # the failed frame's row is about no object
    table = tmp_path / "frames.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:3]))
    with pytest.raises(
        InputError, match=r"frames\.csv holds 2 objects, but run\.json counted 5: it was changed or cut"
    ):
        read_batch(tmp_path)


def test_an_unknown_order_names_those_that_exist(index: BatchIndex) -> None:
    with pytest.raises(SettingsError, match="unknown order 'colour'; available: error, score, misleading, cause"):
        index.sorted_by("colour")  # type: ignore[arg-type]


def test_another_folder_is_no_batch(tmp_path: Path) -> None:
    assert not is_batch_folder(tmp_path)
    with pytest.raises(InputError, match=r"has no run\.json"):
        read_batch(tmp_path)


def test_several_runs_in_a_folder_are_found_by_name(
    index: BatchIndex, tmp_path_factory: pytest.TempPathFactory
) -> None:
    several = tmp_path_factory.mktemp("several")
    for name in ("sir", "rir"):
        shutil.copytree(index.folder, several / name)
    (several / "notes").mkdir()
    assert find_runs(several) == RunSelection((several / "rir", several / "sir"), "")
    assert find_runs(index.folder) == RunSelection((index.folder,), "")
    with pytest.raises(InputError, match="no folder of a batch"):
        find_runs(several / "notes")


def test_runs_further_down_are_taken_where_they_lie_together(
    index: BatchIndex, tmp_path_factory: pytest.TempPathFactory
) -> None:
    top = tmp_path_factory.mktemp("top")
    for name in ("sir", "rir"):
        shutil.copytree(index.folder, top / "may" / "sweep" / name)
    (top / "again").symlink_to(top)
    found = find_runs(top)
    assert found.runs == (top / "may/sweep/rir", top / "may/sweep/sir")
    assert found.note == f"The runs in {top / 'may/sweep'} (2 runs)."
    assert find_runs(top / "may" / "sweep").note == ""


def test_runs_further_down_are_never_left_out_silently(
    index: BatchIndex, tmp_path_factory: pytest.TempPathFactory
) -> None:
    top = tmp_path_factory.mktemp("top")
    for name in ("a/sir", "b/rir", "b/sir"):
        shutil.copytree(index.folder, top / name)
    with pytest.raises(
        InputError, match=r"several folders in it do; name one of them: .*a \(1 run: sir\); .*b \(2 runs: rir, sir\)$"
    ):
        find_runs(top)
    shutil.copytree(index.folder, top / "refine")
    found = find_runs(top)
    assert found.runs == (top / "refine",)
    listed = f"{top / 'a'} (1 run), {top / 'b'} (2 runs)"
    assert found.note == f"Runs further down are left out; to view them, name their folder: {listed}."


def test_what_lies_in_a_run_is_no_run_of_its_own(index: BatchIndex) -> None:
    shutil.copytree(index.folder, index.folder / "recordings" / "copy", ignore=lambda *_: ["recordings"])
    assert find_runs(index.folder) == RunSelection((index.folder,), "")


def test_a_folder_that_nobody_may_look_into(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path) -> Iterator[Path]:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(InputError, match=r"cannot be read \(Permission denied\); expected the folder of a batch"):
        find_runs(tmp_path)


def test_runs_in_a_folder_named_by_mistake_are_listed(
    index: BatchIndex, tmp_path_factory: pytest.TempPathFactory
) -> None:
    top = tmp_path_factory.mktemp("mistake")
    assert named_runs(top) == ""
    names = [f"{place}/{k}" for place in ("a", "b/c") for k in range(4)]
    for name in names:
        (top / name).mkdir(parents=True)
        (top / name / "run.json").write_text("{}")
    assert named_runs(top / "a/1") == str(top / "a/1")
    listed = ", ".join(str(top / name / "recordings") for name in names[:6])
    assert named_runs(top, "recordings") == f"{listed} and 2 more"
    assert named_runs(top / "none") == ""
