"""What is found by typing and by keys alone, and what stays of the page after a reload or a download."""

from __future__ import annotations

from verefine_viz.page import protocol as p
from verefine_viz.page.wire import pose_numbers

LISTED = "document.querySelectorAll('.open-list .item').length"


def test_sessions_open_by_typing_a_part_of_their_name(show, pages, tmp_path_factory):
    folder = tmp_path_factory.mktemp("few")
    (folder / "one.toml").write_text('title = "A pack"\n[scene]\nsource = "demo"\ndemo = "duck"\n')
    (folder / "two.toml").write_text('title = "A jug"\n[scene]\nsource = "demo"\ndemo = "bowl"\n')
    screen = show()
    before, sessions = screen.state("state.frame.id"), screen.app.debugger.list_sessions
    screen.app.debugger.list_sessions = lambda: tuple(sorted(folder.glob("*.toml")))
    try:
        screen.app.debugger.send_frame()
        screen.until("state.frame.sessions.length === 2")
        screen.page.locator(".opener-button").click()
        screen.page.wait_for_timeout(200)
        assert screen.state("document.activeElement.tagName") == "INPUT"
        assert screen.state("document.querySelectorAll('img.scene-picture').length") > 2
        screen.page.keyboard.type("pac", delay=20)
        screen.until(f"{LISTED} === 1")
        screen.shot("open_by_typing")
        screen.key("Enter")
        screen.until("state.frame.id !== arg && state.frame.title === 'A pack'", before)
    finally:
        screen.app.debugger.list_sessions = sessions
    assert screen.state("state.view.edited") is None
    screen.app.send(p.Open(demo="mug"))
    screen.app.wait_until_idle(60)
    assert screen.errors == []


def test_settings_are_found_by_typing_and_taken_back(show):
    screen = show()
    screen.tab("settings")
    screen.page.locator(".settings .filter").fill("tau")
    row = screen.page.locator(".setting-row").first
    field = row.locator("input").first
    was = field.input_value()
    field.fill("0.033")
    screen.until("state.draft['score.tau_m'] === '0.033'")
    row.get_by_role("button").click()
    screen.until("Object.keys(state.draft).length === 0")
    assert field.input_value() == was
    longs = "(({ longName }) => state.frame.choices.settings.map((s) => longName(s.name)))"
    names = screen.state(f"{longs}(await import('/web/tabs/setting.js'))")
    assert len(names) == len(set(names)) > 80
    screen.tab("compare")
    name = screen.page.locator(".new-b input.name")
    name.fill("score: τ [m]")
    assert screen.page.get_by_role("button", name="Run B").is_disabled()
    assert screen.page.locator(".new-b").get_by_text("choose another").is_visible()
    screen.page.locator(".new-b input.setting").fill("0.033")
    assert screen.page.get_by_role("button", name="Run B").is_enabled()
    assert screen.errors == []


def test_a_reload_shows_the_branch_with_its_edited_pose(show):
    screen = show().finish()
    target = screen.app.debugger.space.problem.targets[0]
    edit = p.EditedPose(target.instance.instance_id, 0, pose_numbers(target.instance.T_cam_obj_gt))
    screen.app.send(p.Fork(2, min(screen.app.debugger.space.branches), edit=edit, run=True))
    screen.until("state.branches.length === 2 && state.runs.get(state.branches[1].index)?.over")
    branch = screen.state("state.branches[1].index")
    screen.view(branch=branch, k=3)
    screen.until("location.hash.includes(`branch=${arg}`)", branch)
    screen.page.reload()
    screen.until("state.frame !== null && state.view.branch === arg && state.view.k === 3", branch)
    assert screen.errors == []


def test_a_shared_page_goes_to_the_browser_alone_and_its_message_leaves_with_escape(show, tmp_path):
    screen = show().finish()
    folder = screen.app._folder
    there = set(folder.rglob("*"))
    with screen.page.expect_download(timeout=120_000) as download:
        screen.page.get_by_title("Share:").click()
    download.value.save_as(tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size > 100_000
    assert set(folder.rglob("*")) == there
    screen.until("state.toasts.length === 1 && state.written[0].path === null")
    screen.key("Escape")
    screen.until("state.toasts.length === 0")
    assert screen.errors == []
