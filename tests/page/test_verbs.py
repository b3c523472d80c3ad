"""Verbs: what they change, what windows are told, and that they give the records that a headless run gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import structs

from tests.page.conftest import SESSION, Posted
from tests.page.fake_tools import FakeTools
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.records import TIMES
from verefine_viz.core.settings import SURROUNDINGS
from verefine_viz.page import protocol as p
from verefine_viz.page.protocol import read_verb, write_verb
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.editable_settings import editable_settings
from verefine_viz.page.workspace import Workspace

T_MOVED = (1.0, 0, 0, 0.05, 0, 1, 0, 0.08, 0, 0, 1, 0.7, 0, 0, 0, 1)


def records(debugger: Debugger) -> dict[int, list[dict]]:
    """Return all that the branches recorded, without times."""
    return {b.index: [_plain(i) for i in b.run.iterations] for b in debugger.space.branches.values()}


def _plain(value):
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if hasattr(value, "__struct_fields__"):
        return {name: _plain(v) for name, v in structs.asdict(value).items() if name not in TIMES}
    if isinstance(value, tuple | list):
        return [_plain(v) for v in value]
    return value


def test_run_from_the_page_equals_a_headless_one(debugger: Debugger, posted: Posted):
    debugger.carry_out([p.Step(), p.Step(), p.RunVerb()])
    tools = FakeTools(SESSION)
    run = tools.run(tools.problem("0/1"))
    run.finish()
    assert records(debugger)[0] == [_plain(i) for i in run.iterations]
    rows = [row for message in posted.of("run") for row in message["rows"]]
    assert [row["k"] for row in rows] == list(range(1, run.length + 1))
    for row, iteration in zip(rows, run.iterations, strict=True):
        assert row["stages"][-1]["T"] == iteration.stages[-1].T_cam_obj.ravel().tolist()
        assert [s["score"] for s in row["stages"]] == [s.score and s.score.score for s in iteration.stages]
    assert posted.of("verdict")[-1]["objects"][0]["score"] == run.final_state.best[0].score.score


def test_frames_whose_solids_turn_out_otherwise_begin_again(debugger: Debugger, posted: Posted):
    debugger.carry_out([p.Step(), p.Open(frame="0/2"), p.Step(1)])
    box = next(iter(debugger.space.problem.models.values()))
    posted.clear()
    debugger.begin_again(box)
    assert [message["frame"] for message in posted.of("frame")] == ["0/2"]
    assert debugger.space.work.first.run.length == 0
    debugger.carry_out([p.Open(frame="0/1")])
    assert debugger.space.work.first.run.length == 0
    posted.clear()
    debugger.begin_again(replace(box, name="another", vertices=2 * box.vertices))
    assert not posted


def test_restart_that_discards_branches_asks_first(debugger: Debugger):
    debugger.carry_out([p.Step(), p.Fork(1)])
    with pytest.raises(p.UnconfirmedError, match="discards 1 other branch") as refused:
        debugger.carry_out([p.Restart()])
    assert len(debugger.space.branches) == 2
    debugger.carry_out([refused.value.verb])
    assert len(debugger.space.branches) == 1


def test_every_number_among_the_settings_of_the_page_can_be_changed(debugger: Debugger):
    for setting in editable_settings(SESSION):
        section, _, name = setting.name.partition(".")
        if setting.kind not in ("int", "float") or name in SURROUNDINGS:
            continue
        value = setting.value + 1 if setting.kind == "int" else 0.9 * setting.value or 0.1
        debugger.carry_out([p.Restart(debugger.space.work.first.index, {setting.name: value})])
        assert getattr(getattr(debugger.space.work.first.settings, section), name) == value, setting.name


def test_a_setting_that_is_chosen_has_its_value_among_the_choices():
    opened = structs.replace(SESSION, method=structs.replace(SESSION.method, name="trace"))
    for setting in editable_settings(opened):
        assert setting.choices is None or setting.value in setting.choices, setting.name


def test_fork_shares_iterations_and_goes_on_from_the_edited_pose(debugger: Debugger):
    edit = p.EditedPose(debugger.space.problem.instances[0].instance_id, 1, T_MOVED)
    debugger.carry_out([p.RunVerb(), p.Fork(2, edit=edit, run=True)])
    first, second = debugger.space.branches.values()
    assert first.run.iterations[:2] == second.run.iterations[:2]
    third = second.run.iterations[2]
    assert third.arm == 1
    assert np.allclose(third.stages[0].T_cam_obj.ravel(), T_MOVED)
    assert second.run.is_done


@pytest.mark.parametrize(
    "verb",
    [
        p.Step(7),
        p.Fork(0, changes={"method.nothing": 1}),
        p.Fork(0, changes={"score.tau_m": -1}),
        p.Fork(0, edit=p.EditedPose(99, 0, T_MOVED)),
        p.Fork(0, edit=p.EditedPose(0, 0, (2.0,) * 16)),
        p.Open(frame="9/9"),
        p.Open(session="/nowhere.toml"),
        p.Open(demo="nothing"),
        p.Open(),
        p.Restart(changes={"method.name": "nothing"}),
        p.Compare(b=12),
        p.Compare(changes={"scene.demo": "x"}),
        p.Break({"nothing": 1}),
        p.Order(move=(1, 1)),
        p.BranchVerb(0, remove=True),
        p.Estimate(99, "ppf"),
        p.Tag((0,), "x"),
    ],
)
def test_refused_verb_leaves_everything_as_it_was(debugger: Debugger, verb: p.AnyVerb):
    debugger.carry_out([p.Step()])
    before, log, frame = records(debugger), list(debugger.log), debugger.space.frame_id
    with pytest.raises(VerefineError):
        debugger.carry_out([verb])
    assert records(debugger) == before
    assert debugger.log == log
    assert debugger.space.frame_id == frame
    debugger.carry_out([p.Step()])


def _edited(k: int, branch: int, arm: int) -> p.Fork:
    return p.Fork(k, branch, edit=p.EditedPose(1, arm, T_MOVED), run=True)


verbs = st.one_of(
    st.builds(p.Step, st.integers(0, 3)),
    st.builds(p.RunVerb, st.integers(0, 3), st.sampled_from(["end", "event"])),
    st.builds(p.Seek, st.integers(0, 9), st.integers(0, 3)),
    st.builds(p.Fork, st.integers(0, 9), st.integers(0, 3), st.sampled_from([{}, {"method.exploration": 0.5}])),
    st.builds(_edited, st.integers(0, 5), st.integers(0, 3), st.integers(0, 2)),
    st.builds(p.Restart, st.integers(0, 1), st.sampled_from([{}, {"score.tau_m": 0.01}]), st.booleans()),
    st.builds(lambda changes: p.Compare(changes=changes), st.sampled_from([{}, {"method.name": "sir"}])),
    st.builds(lambda frame: p.Open(frame=frame), st.sampled_from(["0/1", "0/2"])),
    st.builds(lambda stop: p.Break({"arm_switched": stop}), st.booleans()),
    st.builds(lambda index: p.BranchVerb(index, remove=True), st.integers(0, 3)),
)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(verbs, max_size=8))
def test_log_carried_out_again_gives_the_same_records(sequence: list[p.AnyVerb]):
    first = Debugger(Workspace(SESSION, None, FakeTools))
    for verb in sequence:
        try:
            first.carry_out([verb])
        except VerefineError:
            first.pause()
    lines = [write_verb(verb) for verb in first.log]
    again = Debugger(Workspace(SESSION, None, FakeTools)).carry_out(read_verb(line) for line in lines)
    assert again.space.frame == first.space.frame
    assert records(again) == records(first)


def test_unknown_fields_and_wrong_types_are_refused():
    texts = ["", "{", "[]", '{"verb":"step","x":1}', '{"verb":"fork","k":"1"}', '{"verb":"nothing"}', '{"k":1}']
    for text in (*texts, '{"verb":"want","id":"a","of":{"what":"maps","T":[1]}}', "[" * 100_000):
        with pytest.raises(InputError):
            read_verb(text)


def test_breakpoint_stops_a_run_and_says_where(debugger: Debugger, posted: Posted):
    debugger.carry_out([p.Break({"simulated_rejected": True}), p.RunVerb()])
    branch = debugger.space.work.first
    stopped = posted.of("running")[-1]["stopped"]
    assert branch.run.is_done or f"iteration {branch.run.length}:" in stopped
    assert posted.of("running")[-1]["branch"] is None


def test_refining_begins_a_branch_at_that_pose_alone_and_a_saved_session_repeats_it():
    debugger = Debugger(Workspace(SESSION, None, FakeTools, frame="0/2")).carry_out([p.RunVerb()])
    first = debugger.space.work.first
    end, answers = first.run.length, first.run.best_at(first.run.length)
    with pytest.raises(p.UnconfirmedError, match="no iteration is left") as refused:
        debugger.carry_out([p.Fork(end, edit=p.EditedPose(0, 0, T_MOVED))])
    debugger.carry_out([refused.value.verb])
    new = list(debugger.space.branches.values())[1]
    pools = [[h.T_cam_obj.ravel().tolist() for h in t.instance.hypotheses] for t in new.run.problem.targets]
    assert pools == [[list(T_MOVED)], [answers[1].T_cam_obj.ravel().tolist()]]
    assert new.run.is_done
    assert new.run.length == 2 * SESSION.method.iterations
    assert first.run.length == end
    saved = FakeTools(debugger.space.session_of(new))
    again = saved.run(saved.problem("0/2"))
    again.finish()
    assert records(debugger)[new.index] == [_plain(i) for i in again.iterations]
    replayed = Debugger(Workspace(SESSION, None, FakeTools, frame="0/2")).carry_out(debugger.log)
    assert records(replayed)[new.index] == records(debugger)[new.index]


def test_other_objects_begin_where_they_stood_and_a_restart_goes_back_to_the_session():
    debugger = Debugger(Workspace(SESSION, None, FakeTools, frame="0/2"))
    debugger.carry_out([p.Step(), p.Refine(1, T_MOVED, 1)])
    first, new = debugger.space.branches.values()
    ids = [i.instance_id for i in first.run.iterations]
    assert [len(t.instance.hypotheses) for t in new.run.problem.targets] == [1 if 0 in ids else 3, 1]
    debugger.carry_out([p.Restart(new.index, discard=True)])
    assert [len(t.instance.hypotheses) for t in debugger.space.problem.targets] == [3, 3]
    assert debugger.space.work.first.tools.session.starts == ()
