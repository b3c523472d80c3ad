"""Files: nothing is lost by saving, everything can be read back, and the log of verbs gives the same records."""

from __future__ import annotations

from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import numpy as np
import pytest
from msgspec import structs
from PIL import Image

from tests.page.conftest import SESSION, Posted
from tests.page.fake_tools import FakeTools
from tests.page.test_verbs import T_MOVED, records
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import Session
from verefine_viz.page import protocol as p
from verefine_viz.page.app import App
from verefine_viz.page.export import Exporter
from verefine_viz.page.protocol import UnconfirmedError
from verefine_viz.page.replay_verbs import carry_out
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.wire import pose_numbers
from verefine_viz.page.workspace import Workspace
from verefine_viz.recording.reader import read_recording
from verefine_viz.run.session_file import load_session, save_session
from verefine_viz.scenes.results_csv import read_results

EDIT = p.EditedPose(0, 0, T_MOVED)


@pytest.fixture
def debugger(tmp_path: Path, posted: Posted) -> Debugger:
    """Session "mine", opened from its file, beside a file that holds another session."""
    save_session(Session(title="other"), tmp_path / "theirs.toml")
    mine = tmp_path / "mine.toml"
    save_session(structs.replace(SESSION, title="mine"), mine)
    space = Workspace(load_session(mine), mine, FakeTools)
    return Debugger(space, posted, write=Exporter(tmp_path))


def test_another_session_stays_until_the_user_insists(debugger: Debugger, tmp_path: Path):
    theirs = tmp_path / "theirs.toml"
    with pytest.raises(UnconfirmedError, match="another session, “other”") as refused:
        debugger.carry_out([p.Save("session", name="theirs")])
    assert load_session(theirs).title == "other"
    debugger.carry_out([refused.value.verb, p.Save("session", name="theirs"), p.Save("session", name="mine")])
    assert load_session(theirs).title == "mine"


def test_a_pose_that_the_branch_lacks_stays_until_the_user_insists(debugger: Debugger, tmp_path: Path):
    mine = p.Save("session", name="mine", branch=1)
    debugger.carry_out([p.Step(), p.Fork(1, edit=EDIT), mine])
    assert len(load_session(tmp_path / "mine.toml").edits) == 1
    with pytest.raises(UnconfirmedError, match=r"another branch, “hypothesis 1 edited.*”, with 1 edited pose that"):
        debugger.carry_out([p.Save("session", name="mine", branch=0)])
    debugger.carry_out([p.Restart(discard=True)])
    with pytest.raises(UnconfirmedError, match="holds 1 edited pose that this branch does not have"):
        debugger.carry_out([p.Save("session", name="mine", branch=2)])


def test_a_changed_session_gets_the_name_of_its_new_file_as_title(debugger: Debugger, tmp_path: Path):
    save = [p.Save("session", name=name) for name in ("copy", "longer")]
    debugger.carry_out([save[0], p.Restart(changes={"method.iterations": 4}, discard=True)])
    debugger.carry_out([p.Save("session", name="longer", branch=debugger.space.work.first.index)])
    assert [load_session(tmp_path / f"{name}.toml").title for name in ("copy", "longer")] == ["mine", "longer"]


def test_names_stay_within_the_folder(debugger: Debugger, tmp_path: Path):
    there = set(tmp_path.rglob("*"))
    for name in ("../evil", "/tmp/evil", "a/b", " ", "..", "a\\b", "x\ny"):
        for what in ("session", "results"):
            with pytest.raises(InputError, match="is no name of a file"):
                debugger.carry_out([p.Save(what, name=name)])
    assert {path for path in tmp_path.rglob("*") if path.is_file()} <= there


@pytest.mark.usefixtures("processes")
def test_exports_can_be_read_back(debugger: Debugger, tmp_path: Path, posted: Posted):
    obj, T = debugger.space.problem.instances[0].instance_id, debugger.space.problem.instances[0].T_cam_obj_gt
    maps = p.Save("maps", k=3, obj=obj, poses=(("ground truth", pose_numbers(np.asarray(T))),))
    debugger.carry_out([p.RunVerb(), p.Save("results"), maps, p.Save("verbs"), maps])
    debugger.carry_out([p.Save("recording"), p.Save("recording", name="short.vfrun")])
    run, names = debugger.space.work.first.run, [message["name"] for message in posted.of("written")]
    assert names == [
        "mine_0_1_rir.csv", "mine_0_1_rir_maps.png", "mine_0_1_rir_verbs.jsonl", "mine_0_1_rir_maps-2.png",
        "mine_0_1_rir.rrd", "short.vfrun",
    ]  # fmt: skip
    folder = tmp_path / "runs" / "exports"
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    assert np.asarray(Image.open(folder / names[1])).std() > 10
    (row,) = read_results(folder / names[0])
    assert np.allclose(row.T_cam_obj, run.final_state.best[0].T_cam_obj)
    for name in names[4:]:
        record = read_recording(folder / name)
        for one, other in zip(record.iterations, run.iterations, strict=True):
            assert np.array_equal(one.accepted_stage.T_cam_obj, other.accepted_stage.T_cam_obj)
        assert record.is_complete
    debugger.carry_out([p.Open(recording=str(folder / names[5])), p.Save("recording", name="again.vfrun", branch=1)])
    assert read_recording(folder / "again.vfrun").is_complete


def test_a_film_is_for_the_browser_alone(tmp_path: Path, posted: Posted):
    write = Exporter(tmp_path)
    debugger = Debugger(Workspace(SESSION, None, FakeTools), posted, write=write)
    debugger.carry_out([p.RunVerb()])
    for name, kind in (("", "PNG"), ("_film.gif", "GIF")):
        debugger.carry_out([p.Save("film", name=name)])
        message = posted.of("written")[-1]
        assert message["path"] is None
        with Image.open(write.file(message["name"])) as image:
            assert image.format == kind
    write.close()
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_what_was_written_can_be_downloaded_and_nothing_else(open_page, tmp_path: Path):
    app: App = open_page()
    app.send(p.Save("session", name="mine"))
    app.wait_until_idle()
    with urlopen(f"{app.url}/file/mine.toml") as answer:
        assert answer.read() == (tmp_path / "mine.toml").read_bytes()
        assert "attachment" in answer.headers["content-disposition"]
    (tmp_path / "secret.toml").write_text("x")
    for name in ("secret.toml", "..%2Fsecret.toml", "%2Fetc%2Fpasswd"):
        with pytest.raises(HTTPError, match="404"):
            urlopen(f"{app.url}/file/{name}")


def test_the_log_carried_out_again_gives_the_same_records(debugger: Debugger, posted: Posted):
    session = debugger.space.tools.session

    def check() -> None:
        debugger.apply(None, p.Save("verbs"))
        lines = Path(posted.of("written")[-1]["path"]).read_text().splitlines()
        again = carry_out(session, lines, FakeTools)
        assert [b.name for b in again.space.branches.values()] == [b.name for b in debugger.space.branches.values()]
        assert records(again) == records(debugger)

    fork = p.Fork(2, changes={"method.exploration": 0.2}, run=True)
    debugger.carry_out([p.Step(), p.Seek(3), fork, p.Fork(3, 1, edit=EDIT, run=True)])
    debugger.carry_out([p.Compare(changes={"method.name": "sir"}), p.BranchVerb(1, "mine"), p.Open(frame="0/2")])
    check()
    debugger.carry_out([p.RunVerb(4), p.Open(frame="0/1"), p.Break({"arm_switched": True}), p.Fork(2)])
    check()
    debugger.carry_out([p.Break({"arm_switched": False})])
    # A run that is stopped on the way, or that still goes on, is as long again.
    for verb in (p.RunVerb(5), p.Pause(), p.RunVerb(5)):
        debugger.apply(None, verb)
        if debugger.is_running:
            debugger.tick()
    assert debugger.is_running
    check()
    debugger.carry_out([p.Restart(5, {"method.iterations": 4}, True), p.Step(6), p.Order(6, reset=True), p.Step(7)])
    check()
