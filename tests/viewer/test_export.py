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
from verefine_viz.run.session_file import load_session, save_session
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
    with pytest.raises(Unconfirmed, match="another session, “other”") as refused:
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


def test_the_open_file_can_be_chosen_again_from_the_list(app: App, tmp_path: Path) -> None:
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


def test_a_listed_session_opens_by_its_name(debugger: Debugger, tmp_path: Path) -> None:
    theirs = str(tmp_path / "theirs.toml")
    for typed in ("theirs.toml", "theirs"):
        lister = Debugger(Session(), None, FakeTools, sessions=lambda: (str(tmp_path / "mine.toml"), theirs))
        lister.carry_out([c.OpenSession(typed)])
        assert (lister.workspace.session, lister.message) == (OTHER, f"Opened {theirs}."), typed
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


def test_the_session_panel_says_where_what_is_open_was_written(debugger: Debugger, tmp_path: Path) -> None:
    def said() -> tuple[str, str]:
        return opened(debugger.view(deep=False)), open_now(debugger.view(deep=False))

    mine, new = str(tmp_path / "mine.toml"), str(tmp_path / "new.toml")
    words, choice = said()
    assert mine in words
    assert choice == "mine.toml is open"
    debugger.carry_out([c.SaveSession("new")])
    words, choice = said()
    assert mine in words
    assert f"written to {new}" in words
    assert choice == "new.toml is open"
    debugger.carry_out([c.SaveSession("mine")])
    assert "written to" not in said()[0]
    debugger.workspace.open(Session(), None)
    assert said()[1] == CHOOSE
    debugger.carry_out([c.SaveSession("first")])
    assert f"not from a file, written to {tmp_path / 'first.toml'}" in said()[0]


def test_opening_a_file_without_a_name_says_what_to_type(debugger: Debugger) -> None:
    with pytest.raises(InputError, match="no session file is named: type the path of one"):
        debugger.carry_out([c.OpenSession(" ")])
    for name in ("a\0b.toml", f"{'n' * 300}.toml", "/dev/zero", "n/" * 3000):
        with pytest.raises(InputError, match=r"is no path|File name too long|is a device, expected a file"):
            debugger.carry_out([c.OpenSession(name)])


def test_another_branch_of_the_page_is_written_until_the_user_insists(debugger: Debugger, tmp_path: Path) -> None:
    debugger.carry_out([c.SaveSession("new"), FORK])
    with pytest.raises(Unconfirmed, match=r"holds another branch, “first run”\. Nothing was written") as refused:
        debugger.carry_out([c.SaveSession("new")])
    assert not load_session(tmp_path / "new.toml").changes
    debugger.carry_out([refused.value.command, c.Step(), c.SaveSession("new")])
    assert load_session(tmp_path / "new.toml").changes


def test_files_that_hold_something_else_are_written_until_the_user_insists(debugger: Debugger, tmp_path: Path) -> None:
    mine, notes = tmp_path / "mine.toml", tmp_path / "notes.toml"
    edited = mine.read_text().replace("iterations = 2", "iterations = 3")
    mine.write_text(edited)
    notes.write_text("dear diary")
    for name, why in (("mine", "changes that were made since"), ("notes", "something that is no session")):
        with pytest.raises(Unconfirmed, match=why):
            debugger.carry_out([c.SaveSession(name)])
    assert (mine.read_text(), notes.read_text()) == (edited, "dear diary")
    debugger.carry_out([c.SaveSession("new"), FORK, c.SaveSession("changed"), c.Restart()])
    with pytest.raises(Unconfirmed, match="holds settings changed on the way"):
        debugger.carry_out([c.SaveSession("changed")])
    debugger.carry_out([c.OpenSession(str(tmp_path / "theirs.toml"))])
    with pytest.raises(Unconfirmed, match="“mine”"):
        debugger.carry_out([c.SaveSession("new")])


def test_a_file_is_opened_by_its_path_from_home(
    debugger: Debugger, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    debugger.carry_out([c.OpenSession("~/theirs.toml")])
    assert debugger.workspace.session == OTHER


def test_the_page_offers_to_replace_it_until_something_else_is_done(app: App, tmp_path: Path) -> None:
    save_session(OTHER, tmp_path / "theirs.toml")
    app.send(c.SaveSession("theirs"))
    app.wait_until_idle()
    assert _offers_it(app)
    app.send(c.Step())
    app.wait_until_idle()
    assert not _offers_it(app)
    assert load_session(tmp_path / "theirs.toml") == OTHER


def test_it_says_which_settings_are_not_in_the_file_as_they_are_not_in_use(app: App, tmp_path: Path) -> None:
    session, settings = app.page.layout.session, app.page.layout.settings
    with client(app.url) as browser:
        browser.set(settings._fields["method.exploration"], 0.3)
        browser.set(settings._fields["score.tau_m"], 0.01)
        browser.set(session.save, True)
        path = tmp_path / "my_session.toml"
        until(app, lambda: app.debugger.message.startswith(f"Written: {path}"))
    usual = Session()
    said = f"c {usual.method.exploration:g} → 0.3, τ [m] {usual.score.tau_m:g} → 0.01"
    assert said in app.debugger.message
    assert load_session(path).score == usual.score
    assert settings.waiting
    app.send(c.Restart((("method.exploration", 0.3), ("score.tau_m", 0.01))))
    app.wait_until_idle()
    assert not settings.waiting


def _offers_it(app: App) -> bool:
    """Whether a browser that connects now would see the link."""
    sent = app.server._websock_server._broadcast_buffer.message_from_id.values()
    return any(carries(INSIST) in str(getattr(getattr(m, "props", None), "content", "")) for m in sent)
