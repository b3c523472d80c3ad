"""Which runs belong together, and what they are called."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.report.pages import GONE
from tests.report.runs import row, write_run
from tests.report.sections import NO_ANSWER, WRONG, group, run
from verefine_viz.batch.index import BatchIndex, read_batch
from verefine_viz.core.errors import InputError
from verefine_viz.report.groups import differing, read_runs, sections_of


def write(folder: Path, name: str, seed: int = 0, **sections: Any) -> Path:
    raw: dict[str, Any] = {**GONE, "title": name, "hypotheses": {"seed": seed}, "method": {"seed": seed}}
    for section, fields in sections.items():
        raw[section] = {**raw.get(section, {}), **fields} if isinstance(fields, dict) else fields
    return write_run(folder / name, [row(1), row(2)], raw)


def runs(*folders: Path) -> list[BatchIndex]:
    return [read_batch(folder) for folder in folders]


def names(*folders: Path) -> dict[str, list[str]]:
    (only,) = sections_of(runs(*folders))
    return {group.name: [run.folder.name for run in group.runs] for group in only.groups}


def test_runs_that_differ_in_seeds_titles_or_what_changes_no_result_are_one_group(tmp_path: Path) -> None:
    folders = [write(tmp_path, f"{m}-{s}", s, method={"name": m}) for s in (1, 0, 10) for m in ("sir", "rir")]
    assert names(*folders) == {"rir": ["rir-0", "rir-1", "rir-10"], "sir": ["sir-0", "sir-1", "sir-10"]}
    folders = [write(tmp_path, "a"), write(tmp_path, "b", recording={"keep": "none"}, breakpoints={"unstable": True})]
    assert names(*folders) == {"rir": ["a", "b"]}


def test_groups_are_named_by_what_differs_the_method_first(tmp_path: Path) -> None:
    folders = [
        write(tmp_path, "a", method={"name": "rir"}),
        write(tmp_path, "b", method={"name": "rir"}, icp={"stop": "published"}),
        write(tmp_path, "c", method={"name": "sir"}, icp={"stop": "published"}),
    ]
    assert names(*folders) == {"rir · icp.stop max_iterations": ["a"], "rir · icp.stop published": ["b"], "sir": ["c"]}
    (only,) = sections_of(runs(*folders))
    assert differing([group.session for group in only.groups]) == {
        "method.name": ["rir", "rir", "sir"],
        "icp.stop": ["max_iterations", "published", "published"],
    }


def test_a_preset_stands_for_all_that_it_sets_and_numbers_tell_runs_of_one_method_apart(tmp_path: Path) -> None:
    assert set(names(write(tmp_path, "a"), write(tmp_path, "b", preset="published"))) == {"recommended", "published"}
    folders = [write(tmp_path, f"c{c}", method={"exploration": c}) for c in (0.1, 0.5)]
    assert set(names(*folders)) == {"method.exploration 0.1", "method.exploration 0.5"}


def test_only_runs_on_the_same_data_are_compared(tmp_path: Path) -> None:
    mug, duck = ({"scene": {"source": "demo", "demo": name}} for name in ("mug", "duck"))
    folders = [
        write_run(tmp_path / "a", [row(1), row(2)], mug),
        write_run(tmp_path / "b", [row(1), row(2)], {**mug, "method": {"name": "pir"}}),
        write_run(tmp_path / "c", [row(1), row(2)], duck),
        write_run(tmp_path / "d", [row(8)], mug),
        write_run(tmp_path / "e", [row(2), row(3)], {**mug, "method": {"name": "sir"}}),
    ]
    found = sections_of(runs(*folders))
    assert [[run.folder.name for run in section.runs] for section in found] == [["b", "a", "e"], ["c"], ["d"]]
    assert [section.data for section in found] == [
        "the built-in scene mug, frames 1/1, 1/2, 1/3",
        "the built-in scene duck",
        "the built-in scene mug, frames 1/8",
    ]
    assert [section.has_same_objects for section in found] == [False, True, True]


def test_two_runs_that_the_user_names_stay_two() -> None:
    for a, b, said in (
        ({"method": {"name": "pir"}}, {"method": {"name": "rir"}}, ["A: pir", "B: rir"]),
        ({}, {"method": {"exploration": 0.2}}, ["A: method.exploration 0.7", "B: method.exploration 0.2"]),
        ({}, {"preset": "published"}, ["A: recommended", "B: published"]),
        ({}, {"method": {"seed": 3}}, ["A: seed 0", "B: seeds 0, 3"]),
        ({}, {"title": "Another"}, ["A: before", "B: after"]),
    ):
        pair = [run("before", row(1), **a), run("after", row(1), **b)]
        (only,) = sections_of(pair, as_named=True)
        assert [group.name for group in only.groups] == said
        assert only.pair is not None
    assert sections_of(pair)[0].pair is None


def test_runs_that_are_not_finished_or_damaged_are_left_out_with_the_reason(tmp_path: Path) -> None:
    whole, running, broken = (write(tmp_path, name) for name in ("whole", "running", "broken"))
    info = json.loads((running / "run.json").read_text())
    (running / "run.json").write_text(json.dumps({**info, "status": "running"}))
    (broken / "run.json").write_text(json.dumps({**info, "totals": {"objects": 3}}))
    found, left_out = read_runs([whole, running, broken], only_finished=True)
    assert [run.folder for run in found] == [whole]
    assert dict(left_out)["running"] == "not finished (running)"
    assert "counted 3" in dict(left_out)["broken"]
    with pytest.raises(InputError, match="running"):
        read_runs([running, broken], only_finished=True)
    assert [run.folder for run in read_runs([running], only_finished=False)[0]] == [running]


def test_failures_are_wrong_or_missing_answers_worst_first_or_the_lowest_scores() -> None:
    found = group("rir", (row(1), row(2, add_s_mm=30.0), row(3, **WRONG), row(4, **NO_ANSWER)))
    assert [r.im_id for r in found.failures] == [4, 3, 2]
    scores = ((1, 0.9), (2, 0.1), (3, 0.5))
    found = group("rir", tuple(row(k, has_truth=False, add_s_mm=None, score=score) for k, score in scores))
    assert [r.im_id for r in found.failures] == [2, 3, 1]
