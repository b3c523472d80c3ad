"""Edits, changes and cuts that can never apply: refused where they are meant for the frame, else noted in one line."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec import structs

from tests.fakes import box_problem
from verefine_viz.batch.summary import run_end
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import LeftOut
from verefine_viz.core.settings import Change, Edit
from verefine_viz.run.edits import check_edits, edits_elsewhere, edits_of, never_reached
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

PUT = transform(np.eye(3), [0.0, 0.0, 0.6])
FRAME = box_problem(3, 2)
"""Instances 0 and 1 with three hypotheses each."""


def edit(instance: int = 0, hypothesis: int = 0, after: int = 0, frame: str = "", pose: Any = PUT) -> Edit:
    T = tuple(float(x) for x in np.ravel(pose))
    return Edit(after_iteration=after, instance=instance, hypothesis=hypothesis, T_cam_obj=T, frame=frame)


IMPOSSIBLE: tuple[tuple[dict[str, Any], str], ...] = (
    ({"instance": 99, "after": 5}, "instance 99"),
    ({"hypothesis": 7}, "hypothesis 7 of instance 0"),
    ({"pose": np.full(16, np.nan)}, "pose of instance 0 "),
    ({"pose": transform(np.eye(3), [0, 0, 600.0])}, "pose of instance 0 "),
)


@pytest.mark.parametrize("is_named", [True, False])
def test_an_edit_that_is_meant_for_the_frame_and_cannot_be_made_is_refused(is_named: bool) -> None:
    for fields, named in IMPOSSIBLE:
        moved = edit(**fields, frame=FRAME.frame if is_named else "")
        with pytest.raises(InputError, match=f"^edits: .*{named}"):
            check_edits([moved], FRAME, is_only_frame=not is_named)


def test_one_for_every_frame_that_has_the_hypothesis_is_noted_where_it_is_missing() -> None:
    moves = [edit(hypothesis=7), edit(instance=5), edit(), edit(hypothesis=7, after=2)]
    assert check_edits(moves, FRAME, is_only_frame=False) == (
        "the session edits the pose of hypothesis 8 of instance 0, which this frame does not have",
        "the session edits the pose of hypothesis 1 of instance 5, which this frame does not have",
    )


def test_one_of_an_object_that_is_left_out_or_not_asked_for_lets_the_others_go_on() -> None:
    without = replace(FRAME, left_out=(LeftOut(5, 1, "mug", "no model", has_truth=False),))
    moved = edit(instance=5, frame=FRAME.frame)
    assert check_edits([moved], without, False) == ("the edited pose of instance 5 is not used: it is left out",)
    said = ("the edited pose of instance 5 is not used: it is none of the objects to solve",)
    assert check_edits([moved], FRAME, False, has_all_objects=False) == said
    assert edits_of([moved], without) == ()


def test_edits_of_frames_that_the_session_does_not_have_are_named() -> None:
    moves = [edit(frame="0/7"), edit(frame="0/1"), edit(frame="x"), edit()]
    assert edits_elsewhere(moves, ["0/1"]) == ("poses are edited in frames 0/7, x, which are not among those to solve",)
    assert edits_elsewhere(moves, ["0/1", "0/7", "x"]) == ()


def test_what_lies_behind_the_end_of_the_run_is_named_once() -> None:
    late = Change(after_iteration=10**9, settings={"method": {"exploration": 0.2}})
    moves = [edit(after=999), edit(hypothesis=1, after=999), edit(after=25)]
    assert never_reached(moves, [late], 25) == (
        "the run has 25 iterations: no pose is edited after iteration 999",
        "the run has 25 iterations: no setting changes after iteration 1000000000",
    )


@pytest.mark.usefixtures("processes")
def test_a_built_in_frame_says_all_of_it_headless() -> None:
    session = resolve(
        {
            "scene": {"demo": "mug", "model_points": 200, "cloud_points": 200},
            "hypotheses": {"max_per_object": 1},
            "method": {"name": "refine", "iterations": 1},
            "physics": {"enabled": False},
            "dependency": {"cut": [[0, 99]]},
            "edits": [msgspec.to_builtins(edit(after=999)), msgspec.to_builtins(edit(frame="0/5"))],
            "changes": [{"after_iteration": 10**9, "settings": {"method": {"exploration": 0.2}}}],
        }
    )
    toolbox = Toolbox(session)
    assert toolbox.notes == ("poses are edited in frame 0/5, which is not among those to solve",)
    problem = toolbox.problem("0/0")
    cut = "dependency.cut: unknown instance 99; available: 0; it is ignored"
    assert cut in problem.notes
    run = toolbox.run(problem)
    run.finish()
    assert [note for note in run_end(run, session).notes if note.startswith(("dependency", "the run has"))] == [
        cut,
        "the run has 1 iterations: no pose is edited after iteration 999",
        "the run has 1 iterations: no setting changes after iteration 1000000000",
    ]
    with pytest.raises(InputError, match="edits: unknown instance 99; available: 0"):
        Toolbox(structs.replace(session, edits=(edit(instance=99, after=5),))).problem("0/0")
