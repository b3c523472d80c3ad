"""Clusters and dependency order of frames: laws on made-up scenes, and frames of which the answer is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import networkx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from tests.observation.boxes import Box, box_scene
from verefine_viz.core.algorithm_settings import DependencySettings
from verefine_viz.core.problem import DependencyGraph, Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.observation.dependency_graph import dependency_graph
from verefine_viz.scenes.source import open_scene

DEFAULT = DependencySettings()
PUBLISHED = DependencySettings(rule="published")


def kinds(graph: DependencyGraph, kind: str) -> set[tuple[int, int]]:
    return {(e.first, e.second) for e in graph.edges if e.kind == kind}


def one_on_another(size: float = 0.03) -> tuple[Box, ...]:
    return (
        Box(0.0, 0.0, 0.0, (0.10, 0.08, 0.05)),
        Box(0.01, 0.0, 0.05, (size, size, 0.04)),
        Box(0.16, 0.05, 0.0, (0.05, 0.05, 0.06)),
    )


@st.composite
def scenes(draw: st.DrawFn) -> tuple[Box, ...]:
    """Stacks of boxes here and there; they may stand into each other, which makes odd evidence."""
    boxes = []
    for _ in range(draw(st.integers(1, 4))):
        x, y = draw(st.floats(-0.15, 0.15)), draw(st.floats(-0.12, 0.12))
        width, bottom = draw(st.floats(0.03, 0.12)), 0.0
        for _ in range(draw(st.integers(1, 3))):
            height = draw(st.floats(0.01, 0.08))
            boxes.append(Box(x, y, bottom, (width, width, height)))
            bottom, width = bottom + height, width * draw(st.floats(0.5, 1.4))
    return tuple(boxes)


@settings(max_examples=25)
@given(scenes(), st.sampled_from((DEFAULT, PUBLISHED)), st.data())
def test_laws_of_any_scene(boxes: tuple[Box, ...], rule: DependencySettings, data: st.DataObject) -> None:
    graph = dependency_graph(box_scene(boxes), rule)
    ids = range(len(boxes))
    assert sorted(graph.order) == list(ids)
    assert sorted(i for chain in graph.support_lists for i in chain) == list(ids)
    assert all(0 <= e.strength <= 1 for e in graph.edges)

    place = {i: k for k, i in enumerate(graph.order)}
    assert all(place[e.first] < place[e.second] for e in graph.edges if e.kind == "support" and e.state == "used")

    nodes = networkx.Graph([(e.first, e.second) for e in graph.edges])
    nodes.add_nodes_from(ids)
    assert {frozenset(c) for c in graph.clusters} == {frozenset(c) for c in networkx.connected_components(nodes)}

    shuffled = box_scene(boxes, order=data.draw(st.permutations(ids)))
    assert dependency_graph(shuffled, rule) == graph

    pairs = sorted({(e.first, e.second) for e in graph.edges})
    cut = data.draw(st.lists(st.sampled_from(pairs), unique=True)) if pairs else []
    split = dependency_graph(shuffled, structs.replace(rule, cut=tuple(cut)))
    assert all(any(set(part) <= set(whole) for whole in graph.clusters) for part in split.clusters)
    among = {frozenset(pair) for pair in cut}
    assert all((e.state == "cut") == (frozenset((e.first, e.second)) in among) for e in split.edges)


@settings(max_examples=15)
@given(st.integers(2, 4), st.floats(0.7, 1.0))
def test_a_tower_is_solved_from_below(n: int, taper: float) -> None:
    boxes = [Box(0.0, 0.0, 0.04 * k, (0.10 * taper**k, 0.10 * taper**k, 0.04)) for k in range(n)]
    graph = dependency_graph(box_scene(boxes), DEFAULT)
    assert graph.clusters == (tuple(range(n)),)
    assert graph.support_lists == (tuple(range(n)),)
    assert {(k, k + 1) for k in range(n - 1)} <= kinds(graph, "support")


def test_carried_and_alone() -> None:
    graph = dependency_graph(box_scene(one_on_another()), DEFAULT)
    assert graph.clusters == ((0, 1), (2,))
    assert kinds(graph, "support") == {(0, 1)}
    assert kinds(graph, "contact") == {(0, 1)}
    assert graph.notes == ()


def test_side_by_side_carries_nothing_and_is_one_cluster() -> None:
    boxes = (Box(-0.031, 0.0, 0.0, (0.06, 0.06, 0.05)), Box(0.031, 0.0, 0.0, (0.06, 0.06, 0.09)))
    graph = dependency_graph(box_scene(boxes), DEFAULT)
    assert graph.clusters in (((0, 1),), ((1, 0),))
    assert kinds(graph, "support") == set()
    assert kinds(graph, "contact") == {(0, 1)}


def test_what_stands_before_another_hides_it_and_comes_first() -> None:
    boxes = (Box(0.0, 0.10, 0.0, (0.08, 0.04, 0.12)), Box(0.0, -0.05, 0.0, (0.08, 0.04, 0.12)))
    graph = dependency_graph(box_scene(boxes), DEFAULT)
    assert graph.clusters == ((1, 0),)
    assert kinds(graph, "occlusion") == {(1, 0)}
    assert kinds(graph, "contact") == kinds(graph, "support") == set()


def test_a_cut_pair_does_not_count_and_without_instances_there_is_nothing() -> None:
    cut = dependency_graph(box_scene(one_on_another()), DependencySettings(cut=((1, 0),)))
    assert sorted(cut.clusters) == [(0,), (1,), (2,)]
    assert {e.state for e in cut.edges if {e.first, e.second} == {0, 1}} == {"cut"}
    graph = dependency_graph(replace(box_scene(one_on_another()), instances=()), DEFAULT)
    assert (graph.clusters, graph.edges) == ((), ())


def test_without_a_plane_front_to_back() -> None:
    graph = dependency_graph(box_scene(one_on_another(), with_plane=False), DEFAULT)
    assert kinds(graph, "support") == set()
    assert sorted(map(sorted, graph.clusters)) == [[0, 1], [2]]
    assert "no support plane" in graph.notes[0]
    assert "no support plane" in dependency_graph(box_scene(one_on_another(), with_plane=False), PUBLISHED).notes[0]


def test_an_instance_without_depth_is_alone_and_last() -> None:
    problem = box_scene(one_on_another())
    nothing = replace(problem.instances[0], mask=np.zeros_like(problem.instances[0].mask), points_cam=np.zeros((0, 3)))
    blind = replace(problem, instances=(nothing, *problem.instances[1:]))
    for rule in (DEFAULT, PUBLISHED):
        graph = dependency_graph(blind, rule)
        assert graph.clusters[-1] == (0,)
        assert "box1 (#0) has no depth in its mask; solved alone, behind" in graph.notes
    # What it carried now hangs in the air, and that is said.
    hanging = dependency_graph(blind, DEFAULT)
    assert any("box1 (#1) begins" in note and "nothing is seen to carry it" in note for note in hanging.notes)


def test_a_mask_that_leaks_onto_another_object_does_not_make_them_touch() -> None:
    boxes = (Box(0.0, 0.10, 0.0, (0.08, 0.04, 0.12)), Box(0.0, -0.05, 0.0, (0.08, 0.04, 0.12)))
    problem = box_scene(boxes)
    back, front = problem.instances
    rows = np.flatnonzero(front.mask.any(axis=1))
    leaked = back.mask | (front.mask & (np.arange(len(front.mask)) < rows[0] + 5)[:, None])
    graph = dependency_graph(replace(problem, instances=(replace(back, mask=leaked), front)), DEFAULT)
    assert kinds(graph, "contact") == set()
    boxes = (Box(0.0, 0.10, 0.0, (0.08, 0.04, 0.12)), Box(0.0, -0.05, 0.0, (0.08, 0.04, 0.12)))
    problem = box_scene(boxes)
    back, front = problem.instances
    top = np.flatnonzero(front.mask.any(axis=1))[0]
    stolen = front.mask & (np.arange(len(front.mask)) < top + 2)[:, None]
    leaky = (replace(back, mask=back.mask | stolen), replace(front, mask=front.mask & ~stolen))
    graph = dependency_graph(replace(problem, instances=leaky), DEFAULT)
    assert kinds(graph, "contact") == kinds(graph, "support") == set()


# The built-in scenes, whose objects came to rest under physics


def demo(name: str, frame: str = "0/0") -> Problem:
    return open_scene(SceneSettings(demo=name), HypothesesSettings(max_per_object=1)).problem(frame)


@pytest.mark.usefixtures("processes")
def test_the_box_carries_can_and_duck() -> None:
    for frame in ("0/0", "0/2"):
        graph = dependency_graph(demo("stack", frame), DEFAULT)
        assert kinds(graph, "support") == {(0, 1), (0, 2)}, frame
        assert len(graph.clusters) == 1, frame
        assert graph.order[0] == 0, frame


@pytest.mark.usefixtures("processes")
def test_a_bowl_carries_what_is_in_it() -> None:
    # The block's lower end is below the middle of the bowl: heights as a whole do not tell.
    graph = dependency_graph(demo("bowl"), DEFAULT)
    assert kinds(graph, "support") == {(0, 1)}
    assert graph.clusters == ((0, 1),)


@pytest.mark.usefixtures("processes")
def test_nothing_in_the_clutter_carries_anything() -> None:
    for frame in ("0/0", "0/2"):
        graph = dependency_graph(demo("clutter", frame), DEFAULT)
        assert kinds(graph, "support") == set(), frame
        assert graph.notes == (), "all stand on the table, round ones too"


# Real frames


def real(shared_data: Path, folder: str, frame: str, **more: Any) -> Problem:
    scene = SceneSettings(source="bop", dataset=str(shared_data / folder), frames=(frame,), **more)
    return open_scene(scene, HypothesesSettings(max_per_object=1)).problem(frame)


@pytest.fixture(scope="module")
def xapc(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Problem:
    pool = tmp_path_factory.mktemp("xapc") / "pool.csv"
    pool.write_text("scene_id,im_id,obj_id,score,R,t,time\n4,0,8,1,1 0 0 0 1 0 0 0 1,0 0 700,-1\n")
    folder = shared_data / "xapc"
    scene = SceneSettings(source="bop", dataset=str(folder), masks=str(folder / "detections_xapc-test.json"))
    source = open_scene(scene, HypothesesSettings(source="results", files=(str(pool),), max_per_object=1))
    return source.problem(source.frames[0])


@pytest.fixture
def named(shared_data: Path) -> Callable[[Problem, DependencyGraph], Any]:
    def clusters(problem: Problem, graph: DependencyGraph) -> list[list[int]]:
        obj_ids = {i.instance_id: i.obj_id for i in problem.instances}
        return [[obj_ids[i] for i in cluster] for cluster in graph.clusters]

    return clusters


def test_xapc_as_its_authors_say(xapc: Problem, named: Callable[..., Any]) -> None:
    graph = dependency_graph(xapc, DEFAULT)
    assert named(xapc, graph) == [[8, 2], [3]]
    (support,) = [e for e in graph.edges if e.kind == "support"]
    obj_ids = {i.instance_id: i.obj_id for i in xapc.instances}
    assert (obj_ids[support.first], obj_ids[support.second]) == (8, 2)
    assert named(xapc, dependency_graph(xapc, PUBLISHED)) == [[3], [8, 2]]
    given_order = dependency_graph(xapc, DependencySettings(order=((3,), (8, 2))))
    assert named(xapc, given_order) == [[3], [8, 2]]


def test_real_frames_as_they_look(shared_data: Path) -> None:
    for frame, carried in (
        ("49/2365", {("024_bowl", "004_sugar_box")}),
        ("900/2", {("004_sugar_box", "010_potted_meat_can")}),
        ("50/1", set()),
        ("0/1", set()),  # the brick stands in front of the mug; the mug's mask leaks onto it
        ("0/5", set()),
    ):
        problem = real(shared_data, "ycbv", frame)
        graph = dependency_graph(problem, DEFAULT)
        names = {i.instance_id: problem.models[i.obj_id].name for i in problem.instances}
        assert {(names[a], names[b]) for a, b in kinds(graph, "support")} == carried, frame
