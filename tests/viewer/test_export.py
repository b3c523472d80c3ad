"""Saving a session never loses another one unless a person insists."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.viewer.client import client, until
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import transform
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.session.files import load_session, save_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.markup import carries
from verefine_viz.viewer.export import Exporter
from verefine_viz.viewer.handlers.edit_handlers import Unconfirmed
from verefine_viz.viewer.panels.session_panel import CHOOSE, open_now, opened

OTHER = Session(title="other")
FORK = c.Fork((("method.exploration", 0.4),), 0)
INSIST = c.SaveSession("theirs", replace=True)


@pytest.fixture
def debugger(tmp_path: Path) -> Debugger:
    """Session "mine", opened from its file, beside a file that holds another session."""
    server: Any = None  # Sessions are saved without a page.
    save_session(OTHER, tmp_path / "theirs.toml")
    mine = tmp_path / "mine.toml"
    save_session(Session(title="mine", method=MethodSettings(iterations=2)), mine)
    return Debugger(load_session(mine), mine, FakeTools, write=Exporter(server, tmp_path))


def test_another_session_is_written_until_the_user_insists(debugger: Debugger, tmp_path: Path) -> None:
    theirs = tmp_path / "theirs.toml"
    with pytest.raises(Unconfirmed, match=r"theirs\.toml holds another session, “other”\. Nothing was") as refused:
        debugger.carry_out([c.SaveSession("theirs")])
    assert load_session(theirs) == OTHER
    assert refused.value.command == INSIST
    debugger.carry_out([refused.value.command])
    assert load_session(theirs).title == "mine"


def test_its_own_file_and_what_it_wrote_are_saved_again_at_once(debugger: Debugger, tmp_path: Path) -> None:
    debugger.carry_out([FORK, c.SaveSession("mine"), c.SaveSession("new"), c.Step(), c.SaveSession("new"), INSIST])
    again = [c.SaveSession("mine", replace=True), INSIST, c.SaveSession("mine"), c.SaveSession("theirs")]
    debugger.carry_out([c.Restart((("hypotheses.max_per_object", 2),)), *again])
    saved = [load_session(tmp_path / f"{name}.toml") for name in ("mine", "new", "theirs")]
    assert [s.title for s in saved] == ["mine"] * 3
    assert [s.hypotheses.max_per_object for s in saved] == [2, Session().hypotheses.max_per_object, 2]


def test_a_changed_session_gets_the_name_of_its_new_file_as_title(debugger: Debugger, tmp_path: Path) -> None:
    def title(name: str) -> str:
        return load_session(tmp_path / f"{name}.toml").title

    debugger.carry_out([c.SaveSession("copy"), c.Restart((("method.iterations", 3),)), c.SaveSession("longer")])
    assert (title("copy"), title("longer")) == ("mine", "longer")
    debugger.carry_out([c.SaveSession("copy of longer"), c.SaveSession("mine")])
    assert (title("copy of longer"), title("mine")) == ("longer", "mine")
    debugger.workspace.open(Session(), None)
    debugger.carry_out([c.SaveSession("nameless")])
    assert title("nameless") == "nameless"
    debugger.workspace.open(Session(title="boxes"), None)
    debugger.carry_out([c.Restart((("method.iterations", 3),)), c.SaveSession("first"), FORK, c.SaveSession("second")])
    assert (title("first"), title("second")) == ("boxes", "second")


def test_a_pose_that_the_shown_branch_lacks_is_written_until_the_user_insists(
    debugger: Debugger, tmp_path: Path
) -> None:
    T_cam_obj = tuple(transform(np.eye(3), [0.01, 0.08, 0.6]).ravel())
    move = [c.Step(), c.EditPose(), c.DragPose(T_cam_obj), c.ForkFromPose(), c.SaveSession("mine")]
    debugger.carry_out([*move, c.Seek(0), FORK])
    with pytest.raises(Unconfirmed, match=r"another branch, “hypothesis 1 edited.*”, with 1 edited pose that"):
        debugger.carry_out([c.SaveSession("mine")])
    debugger.carry_out([c.Restart()])
    with pytest.raises(Unconfirmed, match="holds 1 edited pose that the shown branch does not have"):
        debugger.carry_out([c.SaveSession("mine")])
    assert len(load_session(tmp_path / "mine.toml").edits) == 1


def test_the_list_of_sessions_says_which_file_was_opened_or_saved_last(debugger: Debugger, tmp_path: Path) -> None:
    def said() -> str:
        return open_now(debugger.view())

    assert said() == "mine.toml is open"
    debugger.carry_out([c.SaveSession("new")])
    assert said() == "new.toml is open"
    debugger.carry_out([c.SaveSession("mine")])
    assert said() == "mine.toml is open"
    debugger.carry_out([c.OpenSession(str(tmp_path / "theirs.toml"))])
    assert said() == "theirs.toml is open"
    assert debugger.message == f"Opened {tmp_path / 'theirs.toml'}."
    debugger.workspace.open(OTHER, None)
    assert said() == CHOOSE


@pytest.mark.usefixtures("processes")
def test_the_open_file_can_be_chosen_again_from_the_list(tmp_path: Path) -> None:
    app = App(Session(title="boxes"), port=0, make_tools=FakeTools, folder=tmp_path).start()
    try:
        app.send(c.SaveSession("mine"))
        app.send(c.Step())
        app.wait_until_idle()
        listed = app.page.layout.session.at_hand
        mine = str(tmp_path / "mine.toml")
        assert (listed.value, listed.options) == ("mine.toml is open", ("mine.toml is open", mine))
        with client(app.url) as browser:
            browser.set(listed, mine)  # A browser sends only another value than it shows.
            until(app, lambda: app.debugger.message == f"Opened {mine}.")
        assert (app.debugger.workspace.run.length, listed.value) == (0, "mine.toml is open")
    finally:
        app.stop()


@pytest.mark.parametrize("typed", ["theirs.toml", "theirs"])
def test_a_listed_session_opens_by_its_name(debugger: Debugger, tmp_path: Path, typed: str) -> None:
    theirs = str(tmp_path / "theirs.toml")
    lister = Debugger(Session(), None, FakeTools, sessions=lambda: (str(tmp_path / "mine.toml"), theirs))
    lister.carry_out([c.OpenSession(typed)])
    assert (lister.workspace.session, lister.message) == (OTHER, f"Opened {theirs}.")
    with pytest.raises(InputError, match=r"^session file their does not exist$"):
        lister.carry_out([c.OpenSession("their")])


def test_a_file_that_is_there_goes_before_a_listed_one_of_its_name(
    debugger: Debugger, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    save_session(Session(title="here"), here / "theirs.toml")
    monkeypatch.chdir(here)
    lister = Debugger(Session(), None, FakeTools, sessions=lambda: (str(tmp_path / "theirs.toml"),))
    lister.carry_out([c.OpenSession("theirs.toml")])
    assert lister.workspace.session.title == "here"


def test_the_session_panel_says_where_what_is_open_was_written(
    debugger: Debugger, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def said() -> str:
        return opened(debugger.view())

    assert f"from {tmp_path / 'mine.toml'}: frame" in said()
    debugger.carry_out([c.SaveSession("new")])
    assert f"from {tmp_path / 'mine.toml'}, written to {tmp_path / 'new.toml'}: frame" in said()
    debugger.carry_out([c.SaveSession("mine")])
    assert "written to" not in said()
    monkeypatch.chdir(tmp_path)
    debugger.carry_out([c.OpenSession("new.toml")])
    assert "from new.toml: frame" in said()
    debugger.workspace.open(Session(), None)
    debugger.carry_out([c.SaveSession("first")])
    assert f"not from a file, written to {tmp_path / 'first.toml'}: frame" in said()


def test_opening_a_file_without_a_name_says_what_to_type(debugger: Debugger) -> None:
    with pytest.raises(InputError, match="no session file is named: type the path of one"):
        debugger.carry_out([c.OpenSession(" ")])
    for name in ("a\0b.toml", f"{'n' * 300}.toml", "/dev/zero", "n/" * 3000):
        with pytest.raises(InputError, match=r"is no path|File name too long|is a device, expected a file"):
            debugger.carry_out([c.OpenSession(name)])


def test_it_says_which_frame_alone_a_session_with_moved_poses_opens(debugger: Debugger, tmp_path: Path) -> None:
    debugger.carry_out([c.SaveSession("both")])
    assert debugger.message == f"Written: {tmp_path / 'both.toml'}"
    debugger.carry_out([c.OpenFrame("0/2"), FORK, c.SaveSession("one")])
    assert "one.toml; it opens frame 0/2 alone: settings changed later belong to it; it holds" in debugger.message
    assert load_session(tmp_path / "one.toml").scene.frames == ("0/2",)


def test_settings_that_the_shown_branch_lacks_are_written_until_a_person_insists(debugger: Debugger) -> None:
    debugger.carry_out([FORK, c.SaveSession("new"), c.Restart()])
    with pytest.raises(Unconfirmed, match="holds settings changed on the way that the shown branch"):
        debugger.carry_out([c.SaveSession("new")])


def test_another_branch_of_the_page_is_written_until_the_user_insists(debugger: Debugger, tmp_path: Path) -> None:
    debugger.carry_out([c.SaveSession("new"), FORK])
    with pytest.raises(Unconfirmed, match=r"holds another branch, “first run”\. Nothing was written") as refused:
        debugger.carry_out([c.SaveSession("new")])
    assert not load_session(tmp_path / "new.toml").changes
    debugger.carry_out([refused.value.command, c.Step(), c.SaveSession("new")])
    assert load_session(tmp_path / "new.toml").changes


def test_the_message_names_the_branch_where_there_are_several(debugger: Debugger) -> None:
    debugger.carry_out([c.SaveSession("new")])
    assert debugger.message.endswith("new.toml")
    debugger.carry_out([FORK, c.SaveSession("forked")])
    assert "; it holds the shown branch, “exploration = 0.4, from iteration 0”" in debugger.message


def test_what_was_written_of_one_session_is_not_lost_to_the_next(debugger: Debugger, tmp_path: Path) -> None:
    debugger.carry_out([c.SaveSession("new"), c.OpenSession(str(tmp_path / "theirs.toml"))])
    with pytest.raises(Unconfirmed, match="“mine”"):
        debugger.carry_out([c.SaveSession("new")])


def test_a_file_is_opened_by_its_path_from_home(
    debugger: Debugger, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    debugger.carry_out([c.OpenSession("~/theirs.toml")])
    assert debugger.workspace.session == OTHER


def test_a_file_that_was_changed_meanwhile_is_written(debugger: Debugger, tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    edited = mine.read_text().replace("iterations = 2", "iterations = 3")
    mine.write_text(edited)
    with pytest.raises(Unconfirmed, match="changes that were made since it was opened"):
        debugger.carry_out([c.SaveSession("mine")])
    assert mine.read_text() == edited


def test_a_file_that_is_no_session_is_written(debugger: Debugger, tmp_path: Path) -> None:
    (tmp_path / "notes.toml").write_text("dear diary")
    with pytest.raises(Unconfirmed, match="something that is no session"):
        debugger.carry_out([c.SaveSession("notes")])
    assert (tmp_path / "notes.toml").read_text() == "dear diary"


@pytest.mark.usefixtures("processes")
def test_the_page_offers_to_replace_it_until_something_else_is_done(tmp_path: Path) -> None:
    save_session(OTHER, tmp_path / "theirs.toml")
    app = App(Session(), port=0, make_tools=FakeTools, folder=tmp_path).start()
    try:
        app.send(c.SaveSession("theirs"))
        app.wait_until_idle()
        assert _offers_it(app)
        app.send(c.Step())
        app.wait_until_idle()
        assert not _offers_it(app)
    finally:
        app.stop()
    assert load_session(tmp_path / "theirs.toml") == OTHER


@pytest.mark.usefixtures("processes")
def test_it_says_which_settings_are_not_in_the_file_as_they_are_not_in_use(tmp_path: Path) -> None:
    app = App(Session(), port=0, make_tools=FakeTools, folder=tmp_path).start()
    try:
        app.wait_until_idle()
        session, settings = app.page.layout.session, app.page.layout.settings
        with client(app.url) as browser:
            browser.set(settings._fields["method.exploration"], 0.3)
            browser.set(settings._fields["score.tau_m"], 0.01)
            browser.set(session.save, True)
            path = tmp_path / "my_session.toml"
            until(app, lambda: app.debugger.message.startswith(f"Written: {path}"))
        usual = Session()
        said = f"c {usual.method.exploration:g} → 0.3, τ [m] {usual.score.tau_m:g} → 0.01; press “Restart with these”"
        assert f"; not in the file, as they were not in use: {said} or “Fork here” in Settings" in app.debugger.message
        assert load_session(path).score == usual.score
        assert said in session._written._handle.content
        assert settings.waiting
        app.send(c.Restart((("method.exploration", 0.3), ("score.tau_m", 0.01))))
        app.wait_until_idle()
        assert not settings.waiting
    finally:
        app.stop()


@pytest.mark.usefixtures("processes")
def test_what_was_written_before_a_refusal_is_reported_to_be_so(tmp_path: Path) -> None:
    app = App(Session(title="boxes"), port=0, make_tools=FakeTools, folder=tmp_path).start()
    try:
        app.wait_until_idle()
        kept = app.page.layout.session._written
        app.send(c.SaveSession("new"))
        app.wait_until_idle()
        assert "<p>Written: <code>" in kept._handle.content
        for command in (FORK, c.SaveSession("new")):
            app.send(command)
            app.wait_until_idle()
        assert "Nothing was written" in app.debugger.message
        assert "Written:" not in kept._handle.content
        assert "<p>Written before: <code>" in kept._handle.content
    finally:
        app.stop()


def _offers_it(app: App) -> bool:
    """Whether a browser that connects now would see the link."""
    sent = app.server._websock_server._broadcast_buffer.message_from_id.values()
    return any(carries(INSIST) in str(getattr(getattr(m, "props", None), "content", "")) for m in sent)
