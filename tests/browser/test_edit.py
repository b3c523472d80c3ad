"""A pose that is moved by the mouse, in the image or in 3D, and a run that goes on from it."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from verefine_viz.page.protocol import RefinedWanted
from verefine_viz.page.wants import ANSWERS

OUTLINE = "(await import('/web/outlines.js')).outlineOf(state.view.edited.obj, state.view.edited.T) !== null"
GIZMO = """(() => {
  const { x, y, width, height } = document.querySelector('.pane.scene iframe').getBoundingClientRect();
  return { x, y, width, height };
})()"""


def begin(show):
    """Begin to edit after two iterations; give the screen, the mouse's place, and what T was."""
    screen = show()
    for k in (1, 2):
        screen.key("ArrowRight")
        screen.until("state.view.k === arg", k)
    screen.key("p")
    screen.until("state.view.edited")
    box = screen.page.locator(".stage canvas").bounding_box()
    return screen, (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2), edited(screen)


def edited(screen):
    return np.array(screen.state("state.view.edited.T")).reshape(4, 4)


def settled(screen, T):
    """Check that what is shown of the edited pose is what the engine says of it."""
    branch = screen.app.debugger.space.branch(screen.state("state.view.branch"))
    target = branch.run.problem.targets[0]
    score = branch.evaluator_of(screen.state("moment.k")).score(target, T).score
    screen.page.locator(".editing b", has_text=f"{score:.3f}").wait_for(timeout=60_000)
    screen.until(OUTLINE)


def test_drag_wheel_and_shift_move_the_pose_and_a_run_continues_from_it(show):
    screen, middle, start = begin(show)
    screen.drag(middle, (40, -10))
    moved = edited(screen)
    assert moved[0, 3] > start[0, 3]
    assert moved[1, 3] < start[1, 3]
    assert moved[2, 3] == start[2, 3]
    assert np.array_equal(moved[:3, :3], start[:3, :3])
    settled(screen, moved)
    screen.page.mouse.move(*middle)
    screen.page.mouse.wheel(0, -100)
    screen.page.mouse.wheel(0, -100)
    away_m = pytest.approx(np.linalg.norm(moved[:3, 3]) + 0.002, abs=1e-6)
    screen.wait(lambda: np.linalg.norm(edited(screen)[:3, 3]) == away_m)
    farther = edited(screen)
    screen.page.keyboard.down("Shift")
    screen.drag(middle, (30, 0))
    screen.page.keyboard.up("Shift")
    T = edited(screen)
    assert np.array_equal(T[:3, 3], farther[:3, 3])
    turn = np.degrees(np.arccos((np.trace(T[:3, :3].T @ farther[:3, :3]) - 1) / 2))
    assert turn == pytest.approx(12, abs=0.1)
    settled(screen, T)
    assert "mm" in screen.page.locator(".editing").inner_text()
    screen.shot("edit_image")
    arm = screen.state("state.view.edited.arm")
    screen.click("Continue from here")
    screen.until("state.branches.length === 2 && state.view.branch === state.branches[1].index && !state.view.edited")
    new = list(screen.app.debugger.space.branches.values())[1]
    assert screen.state("[moment.b.name, moment.b.T]") == ["edited", T.ravel().tolist()]  # Shown at once.
    screen.shot("edit_continued")
    screen.key(" ")
    screen.until("state.runs.get(state.view.branch)?.over")
    again = next(i for i in new.run.iterations[2:] if i.arm == arm)
    assert np.array_equal(again.stages[0].T_cam_obj, T)


END = "(await import('/web/wants.js')).endOf(state, moment)"


def overlap_px(screen, one, other):
    """Give by how much two elements lie over each other from top to bottom."""
    a, b = (screen.page.locator(css).bounding_box() for css in (one, other))
    return min(a["y"] + a["height"], b["y"] + b["height"]) - max(a["y"], b["y"])


def test_refine_this_pose_begins_at_the_end_of_a_run(show):
    screen = show().finish()
    screen.key("p")
    screen.until("state.view.edited")
    assert screen.page.get_by_role("button", name="Refine this pose").is_visible()
    assert screen.page.get_by_role("button", name="Continue from here").count() == 0  # No iteration is left.
    assert overlap_px(screen, ".picture canvas", ".picture .editing") <= 0
    box = screen.page.locator(".stage canvas").bounding_box()
    screen.drag((box["x"] + box["width"] / 2, box["y"] + box["height"] / 2), (25, 8))
    T = edited(screen)
    screen.until(END)
    screen.shot("edit_at_the_end")
    screen.click("Refine this pose")
    screen.until("state.branches.length === 2 && state.view.branch === state.branches[1].index && moment.isAnswer")
    new = list(screen.app.debugger.space.branches.values())[1]
    (target,) = new.run.problem.targets
    assert [h.T_cam_obj.tolist() for h in target.instance.hypotheses] == [T.tolist()]
    assert new.run.length == new.settings.method.iterations
    assert screen.state("moment.best.T") == new.run.final_state.best[0].T_cam_obj.ravel().tolist()
    assert screen.state("moment.starts.length") == 1
    screen.until("moment.verdict?.tone === 'right'")
    screen.shot("edit_refined")


def test_where_refining_ends_is_drawn_for_the_latest_pose(show, monkeypatch):
    answer_of, goes_on, asked, answers = ANSWERS[RefinedWanted], threading.Event(), [], []

    def slow(space, want, blobs):
        asked.append(list(want.T))
        assert goes_on.wait(60)
        answers.append(answer_of(space, want, blobs))
        return answers[-1]

    monkeypatch.setitem(ANSWERS, RefinedWanted, slow)
    screen, middle, start = begin(show)
    for _ in range(600):  # The pose where editing began is asked for.
        if asked:
            break
        screen.page.wait_for_timeout(50)
    for by in ((20, 0), (20, 10), (-30, 5)):
        screen.drag(middle, by)
        screen.page.wait_for_timeout(300)
    T = edited(screen)
    assert screen.state(END) is None
    goes_on.set()
    screen.until(END)
    assert asked == [start.ravel().tolist(), T.ravel().tolist()]  # Those between were given up.
    end = answers[-1].T
    assert screen.state(f"{END}.T") == list(end)
    drawn = "(await import('/web/drawing.js')).contoursOf(moment).find((one) => one.key === 'end')?.items[0].T"
    assert screen.state(drawn) == list(end)
    screen.until(f"(await import('/web/outlines.js')).outlineOf(state.view.edited.obj, {END}.T) !== null")
    screen.page.locator(".editing .end b", has_text=f"{answers[-1].score.score:.3f}").wait_for(timeout=60_000)
    assert ["refined", list(end)] in [[role, list(pose)] for _, pose, role, _ in _drawn_in_3d(screen)]
    screen.shot("edit_drag_and_see")
    screen.key("Enter")  # The end is taken, and undone.
    screen.until("state.view.edited.T.every((x, i) => x === arg[i])", list(end))
    screen.key("Control+z")
    screen.until("state.view.edited.T.every((x, i) => x === arg[i])", T.ravel().tolist())


def _drawn_in_3d(screen):
    """Give what the 3D view is asked to draw."""
    return screen.state("(await import('/web/wants.js')).lookAt(state, moment).draw")


def test_arrows_undo_and_escape(show):
    screen, middle, start = begin(show)
    screen.page.mouse.move(*middle)
    screen.until("state.hoverIn === 'image'")
    screen.key("ArrowRight")
    screen.until("state.view.edited.T[3] !== arg", start[0, 3])
    right = edited(screen)
    assert right[0, 3] == pytest.approx(start[0, 3] + 0.0005)
    screen.key("Shift+ArrowUp")
    screen.until("state.view.edited.past.length === 2")
    turned = edited(screen)
    turn = np.degrees(np.arccos((np.trace(turned[:3, :3].T @ right[:3, :3]) - 1) / 2))
    assert turn == pytest.approx(0.5, abs=1e-3)
    screen.key("Control+ArrowUp")
    screen.until("state.view.edited.past.length === 3")
    assert np.linalg.norm(edited(screen)[:3, 3]) - np.linalg.norm(turned[:3, 3]) == pytest.approx(0.0005)
    for left in (2, 1, 0):
        screen.key("Control+z")
        screen.until("state.view.edited.past.length === arg", left)
    assert np.array_equal(edited(screen), start)
    for _ in range(2):
        screen.key("Control+Shift+z")
    screen.until("state.view.edited.past.length === 2")
    assert np.array_equal(edited(screen), turned)
    assert screen.state("state.view.k") == 2
    screen.key("Escape")
    screen.until("state.view.edited === null")
    assert screen.state("state.branches.length") == 1
    assert "edited" not in screen.state("Object.keys(moment.poses)")


def test_gizmo_in_3d_moves_the_pose_and_keys_work_there(show):
    screen, _, start = begin(show)
    screen.state("(await import('/web/ui.js')).fillPane('scene')")
    screen.page.locator(".pane.scene .loading").wait_for(state="detached", timeout=60_000)
    screen.key("c")  # The camera goes to the object, so the gizmo is in the middle.
    screen.page.wait_for_timeout(4000)
    screen.shot("edit_gizmo")
    box = screen.state(GIZMO)
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    for dx, dy in ((0, 0), (0, 45), (40, -12), (-40, -12), (0, -50)):  # One of the handles is hit.
        screen.drag((middle[0] + dx, middle[1] + dy), (dx or 25, dy or 20))
        screen.page.wait_for_timeout(1500)
        if not np.array_equal(edited(screen), start):
            break
    screen.state("(await import('/web/ui.js')).fillPane('scene')")
    moved = edited(screen)
    assert not np.array_equal(moved, start)
    assert np.linalg.norm(moved[:3, 3] - start[:3, 3]) < 0.5
    settled(screen, moved)
    assert screen.page.evaluate("document.activeElement.tagName") == "IFRAME"
    screen.key("Escape")  # With the focus in the 3D view.
    screen.until("state.view.edited === null")
    screen.key("ArrowLeft")
    screen.until("state.view.k === 1")
