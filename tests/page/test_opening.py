"""What is opened stands at its end: answers of a batch from their run files, recordings, recorded steps, links."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from tests.page.conftest import SESSION, Posted
from tests.page.fake_tools import FakeTools
from tests.page.made_batch import make_batch, solve
from tests.page.test_verbs import records
from tests.scenes.test_trace import write_box, write_trace
from verefine_viz.core.errors import InputError
from verefine_viz.page import protocol as p
from verefine_viz.page.gallery import Gallery, read_gallery
from verefine_viz.page.protocol import write_verb
from verefine_viz.page.replay_verbs import carry_out
from verefine_viz.page.session_titles import titled
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.data_folder import data_at
from verefine_viz.run.record import FORMAT, RunEnd, RunHeader
from verefine_viz.run.run_file import RunFile, read_run_file
from verefine_viz.run.session_file import changed, save_session, session_toml
from verefine_viz.run.toolbox import Toolbox


class NeverSteps(FakeTools):
    """Fails where an iteration is computed."""

    @property
    def method(self):
        method = super().method
        method.step = None  # type: ignore[method-assign]
        return method


def debugger_of(gallery: Gallery, posted: Posted, tools: type[FakeTools] = FakeTools) -> Debugger:
    first = gallery.worst.run
    space = Workspace(gallery.session(first), None, tools, records=gallery.records(first))
    return Debugger(space, posted, gallery=gallery)


@pytest.fixture
def gallery(tmp_path: Path) -> Gallery:
    """Runs "rir" and "sir" of frames 0/1 and 0/2."""
    make_batch(tmp_path / "rir")
    make_batch(tmp_path / "sir", changed(SESSION, {"method": {"name": "sir"}}))
    return read_gallery(tmp_path)


def test_an_answer_opens_from_its_run_file_at_the_iteration_that_the_gallery_names(gallery: Gallery, posted: Posted):
    d = debugger_of(gallery, posted, NeverSteps)
    for key, entry in enumerate(gallery.entries):
        posted.clear()
        d.carry_out([p.Open(answer=key)])
        branch = d.space.work.first
        assert (d.space.frame, branch.settings.method.name) == (entry.row.frame, entry.run)
        assert branch.is_over
        assert branch.recording == gallery.records(entry.run)(d.space.frame)
        view = posted.of("view")[-1]
        assert (view["at"], view["patch"]["obj"]) == (entry.iteration, entry.row.instance_id)
        assert sum(len(message["rows"]) for message in posted.of("run")) == branch.run.length
        assert posted.of("verdict")
        assert posted.of("frame")[-1]["run"] == entry.run


def test_a_frame_from_its_run_file_can_be_forked_and_restarted(gallery: Gallery, posted: Posted):
    d = debugger_of(gallery, posted)
    d.carry_out([p.Open(answer=0)])
    d.carry_out([p.Fork(2, d.space.work.first.index, {"method.exploration": 0.1}, run=True)])
    recorded, fork = d.space.branches.values()
    assert fork.run.is_done
    answer, length = recorded.run.final_state.best[0].T_cam_obj, recorded.run.length
    for one, other in zip(recorded.run.iterations[:2], fork.run.iterations[:2], strict=True):
        assert np.array_equal(one.accepted_stage.T_cam_obj, other.accepted_stage.T_cam_obj)
    d.carry_out([p.Restart(recorded.index, discard=True)])
    assert d.space.work.first.run.length == 0
    d.carry_out([p.RunVerb(d.space.work.first.index)])
    run = d.space.work.first.run
    assert run.length == length
    assert np.array_equal(run.final_state.best[0].T_cam_obj, answer)


def test_frames_with_other_settings_than_the_batch_are_run_again(tmp_path: Path, gallery: Gallery, posted: Posted):
    d = debugger_of(gallery, posted)
    other = "0/2" if d.space.frame == "0/1" else "0/1"
    d.carry_out([p.Restart(d.space.work.first.index, {"method.exploration": 0.1}), p.Open(frame=other)])
    assert d.space.work.first.recording is None
    own = read_gallery(tmp_path, {"method": {"exploration": 0.1}})
    d = debugger_of(own, posted)
    d.carry_out([p.Open(answer=0)])
    assert d.space.work.first.recording is None
    assert d.space.work.first.is_over
    assert posted.of("view")[-1]["at"] == own.entries[0].iteration


def test_run_files_of_any_names_are_a_gallery_too(tmp_path: Path, posted: Posted):
    solve(tmp_path / "first try.vfrun")
    solve(tmp_path / "second.vfrun", changed(SESSION, {"method": {"name": "sir"}}))
    gallery = read_gallery(tmp_path)
    d = debugger_of(gallery, posted)
    keys = {entry.row.method: key for key, entry in enumerate(gallery.entries)}
    for method, name in (("rir", "first try.vfrun"), ("sir", "second.vfrun")):
        d.carry_out([p.Open(answer=keys[method])])
        assert d.space.work.first.recording == tmp_path / name


def test_a_recording_opens_at_its_end(tmp_path: Path, debugger: Debugger, posted: Posted):
    solve(tmp_path / "run.vfrun", frame="0/2")
    debugger.carry_out([p.Open(recording=str(tmp_path / "run.vfrun"))])
    assert posted.of("view")[-1]["at"] is None
    assert posted.of("verdict")
    written = read_run_file(tmp_path / "run.vfrun").iterations
    assert first_difference(written, debugger.space.work.first.run.iterations) is None


def test_recorded_steps_are_there_at_once(tmp_path: Path, posted: Posted):
    write_trace(tmp_path / "trace", write_box(tmp_path / "box.obj"))
    known = data_at(tmp_path / "trace", {})
    assert known is not None
    d = Debugger(Workspace(known.session, None, Toolbox), posted)
    assert d.is_running
    d.carry_out([])
    while d.is_running:
        d.tick()
    assert d.space.work.first.is_over
    assert posted.of("verdict")


def test_links_name_a_frame_an_object_an_iteration_and_a_run(gallery: Gallery, posted: Posted):
    d = debugger_of(gallery, posted)
    d.carry_out([p.Open(link="frame=0/2&instance=1&iteration=2&run=sir")])
    assert (d.space.frame, d.space.batch_run) == ("0/2", "sir")
    assert (posted.of("view")[-1]["at"], posted.of("view")[-1]["patch"]["obj"]) == (2, 1)
    d.carry_out([p.Open(link="instance=7&iteration=99")])
    notes = [message["text"] for message in posted.of("note")]
    assert notes[-2:] == ["Frame 0/2 holds no instance 7.", "The run has no iteration 99: 6 is its last."]
    with pytest.raises(InputError, match="unknown run 'pir'"):
        d.carry_out([p.Open(link="frame=0/1&run=pir")])


def test_without_a_batch_there_are_no_answers(debugger: Debugger):
    for verb in p.Open(answer=0), p.Tag((0,), "x"):
        with pytest.raises(InputError, match="no batch is open; open one with verefine-viz view FOLDER"):
            debugger.apply(None, verb)


def test_tags_lie_beside_their_runs(gallery: Gallery, tmp_path: Path, posted: Posted):
    d = debugger_of(gallery, posted)
    d.carry_out([p.Tag((0, 3), " handle  hidden "), p.Tag((0,), "b")])
    tags = {row["key"]: row["tags"] for row in posted.of("answers")[-1]["rows"] if row["tags"]}
    assert tags == {0: ["handle hidden", "b"], 3: ["handle hidden"]}
    again = read_gallery(tmp_path)
    assert again.tags_of(again.entries[3]) == ("handle hidden",)
    d.carry_out([p.Tag((0, 3), "handle hidden", on=False)])
    assert read_gallery(tmp_path).tags_of(again.entries[0]) == ("b",)


def test_the_gallery_gives_every_answer_once_in_every_order(gallery: Gallery, posted: Posted):
    debugger_of(gallery, posted).welcome(1)
    (message,) = posted.of("answers")
    assert [row["key"] for row in message["rows"]] == list(range(6))
    for order in message["orders"]:
        assert sorted(order["keys"]) == list(range(6)), order["id"]
    errors = [message["rows"][key]["err"] for key in message["orders"][0]["keys"]]
    assert errors == sorted(errors, reverse=True)


def test_a_folder_of_run_files_without_an_answer_is_refused(tmp_path: Path):
    file = RunFile(tmp_path / "a.vfrun", SESSION)
    file.begin(RunHeader(FORMAT, session_toml(SESSION), "0/0", "", {}, ()))
    file.finish(RunEnd(answers=()))
    with pytest.raises(InputError, match=r"no run in .* has an answer; open one by itself"):
        read_gallery(tmp_path)


def test_sessions_are_listed_by_their_titles(tmp_path: Path):
    save_session(structs.replace(SESSION, title="A carton"), tmp_path / "failure_wrong_plane.toml")
    save_session(SESSION, tmp_path / "failure_mask_leaks.toml")
    (tmp_path / "broken.toml").write_text("[")
    names = [one.title for one in titled(sorted(tmp_path.glob("*.toml")))]
    assert names == ["broken", "mug 2", "A carton"]


def test_the_log_opens_answers_again(gallery: Gallery, posted: Posted):
    d = debugger_of(gallery, posted)
    d.carry_out([p.Open(answer=0)])
    d.carry_out([p.Fork(0, d.space.work.first.index)])
    d.carry_out([p.Step(max(d.space.branches)), p.RunVerb(max(d.space.branches))])
    lines = [write_verb(verb) for verb in d.log]
    again = carry_out(gallery.session(gallery.worst.run), lines, FakeTools, gallery)
    assert records(again) == records(d)


def test_a_first_frame_that_cannot_be_read_is_passed_over_and_noted():
    class WithoutTheFirst(FakeTools):
        def problem(self, frame, **_):
            if frame == "0/1":
                raise InputError("depth/000001.png is cut off")
            return super().problem(frame)

    space = Workspace(SESSION, None, WithoutTheFirst)
    assert space.frame == "0/2"
    assert space.frames == ("0/1", "0/2")
    assert space.problem.notes[-1] == "frame 0/1 cannot be read and is passed over: depth/000001.png is cut off"
    with pytest.raises(InputError, match=r"^depth/000001.png is cut off$"):  # It is asked for by its name.
        Workspace(SESSION, None, WithoutTheFirst, frame="0/1")


def test_an_answer_opens_with_another_run_of_its_frame_beside_it(gallery: Gallery, posted: Posted):
    d = debugger_of(gallery, posted)
    run = gallery.answer(0)
    file = gallery.runs[run.run].folder / "runs"
    other = next(path for path in sorted(file.glob("*.vfrun")) if path.stem == "000000_00000" + run.row.frame[-1])
    d.carry_out([p.Open(answer=0, beside=str(other))])
    assert d.space.work.compare is not None
    a, b = (d.space.branches[index] for index in d.space.work.compare)
    assert (a is d.space.work.first, b.recording == other) == (True, True)
    assert posted.of("view")[-1]["at"] is None  # both at their ends, not where the answer went wrong
    n = len(d.space.branches)
    d.carry_out([p.Open(answer=0, beside=str(other))])
    assert len(d.space.branches) == n
