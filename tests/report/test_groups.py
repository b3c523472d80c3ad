"""Which runs belong together, and what their groups are called."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.report.runs import row, write_run
from verefine_viz.core.errors import InputError
from verefine_viz.report.groups import Groups, differing, load_groups
from verefine_viz.report.run_results import load

GONE = {"source": "bop", "dataset": "/nowhere/at/all"}


def write(folder: Path, name: str, seed: int = 0, **sections: dict[str, Any]) -> Path:
    raw: dict[str, Any] = {"title": name, "scene": GONE, "hypotheses": {"seed": seed}, "method": {"seed": seed}}
    for section, fields in sections.items():
        raw[section] = {**raw.get(section, {}), **fields} if isinstance(fields, dict) else fields
    return write_run(folder / name, [row(1), row(2)], raw)


def names(groups: Groups) -> dict[str, list[str]]:
    return {group.name: [run.folder.name for run in group.runs] for group in groups.groups}


def test_runs_that_differ_in_seeds_titles_or_what_changes_no_result_are_one_group(tmp_path: Path) -> None:
    folders = [write(tmp_path, f"{m}-{s}", s, method={"name": m}) for s in (1, 0, 10) for m in ("sir", "rir")]
    assert names(load_groups(folders)) == {"rir": ["rir-0", "rir-1", "rir-10"], "sir": ["sir-0", "sir-1", "sir-10"]}
    folders = [write(tmp_path, "a"), write(tmp_path, "b", recording={"keep": "none"}, breakpoints={"unstable": True})]
    assert names(load_groups(folders)) == {"rir": ["a", "b"]}


def test_groups_are_named_by_what_differs_the_method_first(tmp_path: Path) -> None:
    folders = [
        write(tmp_path, "a", method={"name": "rir"}),
        write(tmp_path, "b", method={"name": "rir"}, icp={"stop": "published"}),
        write(tmp_path, "c", method={"name": "sir"}, icp={"stop": "published"}),
    ]
    groups = load_groups(folders)
    assert names(groups) == {"rir · icp.stop max_iterations": ["a"], "rir · icp.stop published": ["b"], "sir": ["c"]}
    assert differing([group.session for group in groups.groups]) == {
        "method.name": ("rir", "rir", "sir"),
        "icp.stop": ("max_iterations", "published", "published"),
    }


def test_a_preset_stands_for_all_that_it_sets_and_numbers_tell_runs_of_one_method_apart(tmp_path: Path) -> None:
    folders = [write(tmp_path, "a"), write(tmp_path, "b", preset="published")]  # type: ignore[arg-type]
    assert set(names(load_groups(folders))) == {"recommended", "published"}
    folders = [write(tmp_path, f"c{c}", method={"exploration": c}) for c in (0.1, 0.5)]
    assert set(names(load_groups(folders))) == {"method.exploration 0.1", "method.exploration 0.5"}


def test_runs_that_are_not_finished_or_damaged_are_left_out_with_the_reason(tmp_path: Path) -> None:
    whole, running, broken = (write(tmp_path, name) for name in ("whole", "running", "broken"))
    run = json.loads((running / "run.json").read_text())
    (running / "run.json").write_text(json.dumps({**run, "status": "running"}))
    (broken / "run.json").write_text(json.dumps({**run, "totals": {"objects": len(load(broken).rows) + 1}}))
    found = load_groups([whole, running, broken])
    assert [r.folder for r in found.runs] == [whole]
    assert dict(found.left_out)["running"] == "not finished (running)"
    assert "it was changed or cut off" in dict(found.left_out)["broken"]
    with pytest.raises(InputError, match=r"none of the 2 runs .* running: not finished"):
        load_groups([running, broken])


def test_runs_on_other_data_are_not_compared(tmp_path: Path) -> None:
    folders = [write(tmp_path, "a"), write(tmp_path, "b", scene={"dataset": "/other/set"})]
    with pytest.raises(InputError, match="only runs on the same data compare"):
        load_groups(folders)
