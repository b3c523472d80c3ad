"""A scene of several objects: its order, its passes, its tree, and the maps of the whole scene."""

from __future__ import annotations

import numpy as np
import pytest

from verefine_viz.page import protocol as p


def solving(show, method):
    """A window of the clutter, restarted with a method that solves scenes."""
    screen = show("clutter")
    app = screen.app
    app.send(p.Restart(min(app.debugger.space.branches), {"method.name": method, "method.iterations": 1}, True))
    app.wait_until_idle(60)
    screen.until("state.branches[0].method === arg && state.runs.get(state.view.branch)?.rows.length === 0", method)
    return screen


def order_of(screen):
    return [list(c) for c in screen.app.debugger.space.problem.dependencies.clusters]


def test_order_is_changed_and_reset_and_each_restarts_the_run(show):
    screen = solving(show, "vf_depth")
    screen.key("ArrowRight")
    screen.until("state.view.k === 1")
    screen.tab("order")
    before = order_of(screen)
    assert [i for cluster in before for i in cluster] == screen.state("state.frame.order.clusters.flat()")
    screen.shot("order")
    screen.page.get_by_title("solve it later").first.click()
    screen.until("state.frame.order.source === 'given' && state.runs.get(state.view.branch)?.rows.length === 0")
    moved = order_of(screen)
    assert moved != before
    assert screen.state("state.frame.order.clusters") == moved
    screen.click("Back to the rule's order")
    screen.until("state.frame.order.source !== 'given'")
    assert order_of(screen) == before
    screen.click("Cut")
    screen.until("state.frame.order.edges.some(e => e.state === 'cut')")
    cut = {(e.first, e.second) for e in screen.app.debugger.space.problem.dependencies.edges if e.state == "cut"}
    assert len({frozenset(pair) for pair in cut}) == 1
    screen.shot("order_cut")
    screen.click("Restore")
    screen.until("state.frame.order.edges.every(e => e.state !== 'cut')")


def test_passes_are_charted_and_maps_show_the_whole_scene(show):
    screen = solving(show, "vf_depth")
    screen.key(" ")
    screen.until("state.runs.get(state.view.branch)?.over")
    run = screen.app.debugger.space.work.first.run
    closing = [i for i in run.iterations if i.scene is not None]
    screen.state("(await import('/web/cursor.js')).seek(arg)", closing[-1].index)
    screen.until("moment.k === arg", closing[-1].index)
    screen.tab("bandit")
    screen.text("Passes over").scroll_into_view_if_needed()
    facts = dict(zip(screen.page.locator(".tab.bandit .facts dt").all_inner_texts(),
                     screen.page.locator(".tab.bandit .facts dd").all_inner_texts(), strict=True))  # fmt: skip
    scene = closing[-1].scene
    assert float(facts["its score"]) == pytest.approx(scene.score.score, abs=6e-4)
    assert float(facts["incumbent"]) == pytest.approx(scene.incumbent_score, abs=6e-4)
    screen.shot("scene_passes")
    screen.click("All objects")
    screen.until("state.view.together")
    sides = "(await import('/web/sides.js')).sidesOf(moment)"
    screen.until(f"{sides}.a?.pose.poses && !{sides}.a.stale && !{sides}.b.stale")
    poses = screen.state(f"{sides}.b.pose.poses")
    problem = run.problem
    targets = [problem.target(obj) for obj, _ in poses]
    Ts = np.array([T for _, T in poses]).reshape(-1, 4, 4)
    assert all(np.array_equal(T, t.instance.T_cam_obj_gt) for t, T in zip(targets, Ts, strict=True))
    score = screen.app.debugger.space.work.first.evaluator_of(screen.state("moment.k")).scene_score(targets, Ts)
    assert screen.state(f"{sides}.b.score.score") == pytest.approx(score.score)
    screen.shot("scene_maps")


def test_tree_of_a_tree_search(show):
    screen = solving(show, "physim_mcts")
    k = 60
    screen.app.send(p.Seek(k, screen.state("state.view.branch")))
    run = screen.app.debugger.space.work.first.run
    screen.tab("bandit")
    screen.until("moment.k === arg", k)
    cluster = run.iterations[k - 1].tree.cluster
    steps = [i.tree for i in run.iterations[:k] if i.tree is not None and i.tree.cluster == cluster]
    nodes = sum(step.node is not None for step in steps)
    screen.text(f"{nodes} nodes.")
    cost = min(step.incumbent_cost_px for step in steps)
    screen.text(f"leaves {round(cost):,} px unexplained")
    assert screen.page.locator("svg.tree g.node").count() > 0
    screen.shot("scene_tree")
    assert screen.errors == []
