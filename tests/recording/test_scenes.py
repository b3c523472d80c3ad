"""What recordings of several objects show."""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from tests.fakes import FakeVerifier, box_model, box_problem
from tests.methods.test_physim_mcts import clustered, method_of
from tests.recording.runs import new_run, recorded_run, session
from verefine_viz.core.problem import DependencyGraph, Edge, Problem
from verefine_viz.core.surroundings import SupportSurface, Surroundings, UnknownObject
from verefine_viz.pictures.surroundings_meshes import drawn_surroundings
from verefine_viz.recording import entities
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.run.engine import Run
from verefine_viz.run.run_file import RunFile, read_run_file


def column(path: Path, entity: str, component: str) -> list[Any]:
    """All rows of a component, in order of iterations."""
    rows: list[Any] = []
    for chunk in chunks_of(path):
        if chunk.entity_path == entity:
            batch = chunk.to_record_batch()
            at = batch.schema.get_field_index(component)
            rows += batch.column(at).to_pylist() if at >= 0 else []
    return rows


def graphed(problem: Problem, *clusters: tuple[int, ...]) -> Problem:
    edges = tuple(Edge("occlusion", a, b, 1.0, "in front") for c in clusters for a, b in pairwise(c))
    return replace(problem, dependencies=DependencyGraph(edges, clusters, clusters, "given"))


@pytest.mark.usefixtures("processes")
def test_a_hypothesis_that_the_method_adds_is_one_of_the_recorded(tmp_path: Path) -> None:
    problem = clustered(box_problem(2, 2), (0, 1))
    s = session("physim_mcts", maps=False)
    recorder, file = Recorder(tmp_path / "run.rrd", s, problem), RunFile(tmp_path / "run.vfrun", s)
    run = Run(method_of(problem), problem, (recorder, file))
    run.finish()
    recorder.close()
    header = read_run_file(file.path).header
    pools = [instance.hypotheses for instance in run.problem.instances]
    assert [len(one.hypotheses) for one in header.objects] == [len(pool) for pool in pools] == [3, 3]
    entity = f"{entities.CURVES}/score/0_box"
    names = [
        column(tmp_path / "run.rrd", f"{entity}/{name}", "SeriesLines:names") for name in ("h1", "h2", "h3", "best")
    ]
    assert names == [[["hypothesis 1"]], [["hypothesis 2"]], [["hypothesis 3"]], [["best"]]]
    for name in ("h1", "h2", "h3", "best"):
        assert {len(row) for row in column(tmp_path / "run.rrd", f"{entity}/{name}", "Scalars:scalars")} == {1}


@pytest.mark.parametrize("clusters", [((1, 0, 2),), ((0, 1), (2,)), ((0,), (1,), (2,))])
def test_nodes_of_a_graph_are_apart_and_no_edge_runs_through_a_third(
    tmp_path: Path, clusters: tuple[tuple[int, ...], ...]
) -> None:
    recorded_run(tmp_path / "run.rrd", session("vf_breadth", maps=False), graphed(box_problem(2, 3), *clusters))
    (nodes,) = column(tmp_path / "run.rrd", f"{entities.GRAPH}/objects", "GraphNodes:positions")
    (edges,) = column(tmp_path / "run.rrd", f"{entities.GRAPH}/objects", "GraphEdges:edges")
    places = np.array(nodes)
    assert len(edges) == sum(len(c) - 1 for c in clusters)
    for j, a in enumerate(places):
        for k, b in enumerate(places[:j]):
            assert np.abs(a - b)[0] > 150 or np.abs(a - b)[1] > 60
            for c in np.delete(places, [j, k], axis=0):
                assert distance(c, a, b) > 30


def distance(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """From a point to the line between two others."""
    along = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return float(np.linalg.norm(a + along * (b - a) - point))


@pytest.mark.parametrize(
    ("name", "n_objects", "maps"),
    [
        ("sir", 1, True), ("rir", 1, False), ("rir", 3, True), ("vf_breadth", 3, False), ("vf_depth", 3, True),
        ("physim_mcts", 3, False),
    ],
)  # fmt: skip
def test_there_is_something_in_every_view(tmp_path: Path, name: str, n_objects: int, maps: bool) -> None:
    problem = graphed(box_problem(3, n_objects), tuple(range(n_objects)))
    s = session(name, maps=maps)
    recorder = Recorder(tmp_path / "run.rrd", s, problem, lambda _: FakeVerifier())
    run = Run(method_of(problem), problem, (recorder,)) if name == "physim_mcts" else new_run(s, problem, (recorder,))
    run.finish()
    recorder.close()
    drawn = {c.entity_path for c in chunks_of(tmp_path / "run.rrd") if c.num_rows}
    for title, origin in views(tmp_path / "run.rrd"):
        assert any(entity.startswith(origin) for entity in drawn), f"{title} is empty"


def views(path: Path) -> list[tuple[str, str]]:
    """Title and origin of each view."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reader = RrdReader(path)
    (blueprint,) = reader.blueprints()
    found: list[tuple[str, str]] = []
    for chunk in reader.stream(store=blueprint).to_chunks():
        batch = chunk.to_record_batch()
        names = [batch.schema.get_field_index(f"ViewBlueprint:{n}") for n in ("display_name", "space_origin")]
        if min(names) >= 0:
            title, origin = (batch.column(n).to_pylist()[0][0] for n in names)
            found.append((title, origin))
    assert found
    return found


# Surroundings of a frame in its recording: what supports, what else stands there, unknown objects, both ups.


UP = np.array([0.0, 0.0, 1.0])
SQUARE = np.array([[-0.3, 0.0], [0.3, 0.0], [0.3, 2.0], [-0.3, 2.0]])


def around(is_dropped: bool = False, catches: bool = False) -> Surroundings:
    """A floor, a step of 5 cm on it, a solid that is no top of it, an unknown object."""
    floor, step = SupportSurface(UP, 0.0, np.zeros((0, 2))), SupportSurface(UP, -0.05, SQUARE)
    unknown = UnknownObject(1, box_model(), np.ones((60, 80), bool), is_dropped)
    return Surroundings("observed", floor, catches, (step,), (box_model(2), box_model(3)), (unknown,))


def drawn(path: Path, tilted: bool = False) -> set[str]:
    problem = box_problem(2, 1)
    support = problem.observation.support
    assert support is not None
    normal = np.array([0.0, 0.1, np.sqrt(0.99)]) if tilted else UP
    support = replace(support, surroundings=None if tilted else around(), normal_world=normal)
    problem = replace(problem, observation=replace(problem.observation, support=support))
    recorded_run(path, problem=problem)
    return {chunk.entity_path for chunk in chunks_of(path)}


def test_a_recording_holds_what_stands_around_the_objects(tmp_path: Path) -> None:
    there = drawn(tmp_path / "run.rrd")
    assert {entities.SURFACES, entities.SOLIDS, f"{entities.UNKNOWN}/1", entities.GRAVITY} <= there
    assert not {entities.PLANE, entities.NORMAL} & there
    there = drawn(tmp_path / "tilted.rrd", tilted=True)
    assert {entities.PLANE, entities.NORMAL, entities.GRAVITY} <= there
    assert entities.SURFACES not in there


def test_surfaces_are_drawn_around_the_objects_only() -> None:
    shown = drawn_surroundings(around(), np.array([0.0, 0.1, 0.0]), 0.4)
    vertices, faces = shown.surfaces
    assert len(faces) == 4
    np.testing.assert_allclose(sorted(set(np.round(vertices[:, 2], 3))), [0.0, 0.05], atol=0.001)
    step = vertices[vertices[:, 2] > 0.04]
    np.testing.assert_allclose([step[:, 0].min(), step[:, 0].max()], [-0.3, 0.3])
    np.testing.assert_allclose([step[:, 1].min(), step[:, 1].max()], [0.0, 0.5])
    assert len(shown.solids[1]) == len(box_model().faces)  # Not the one below the step.
    only_seen = drawn_surroundings(around(catches=True), np.zeros(3), 0.4).surfaces
    assert len(only_seen[1]) == 2
    assert drawn_surroundings(around(is_dropped=True), np.zeros(3), 0.4).unknown[0][1] != shown.unknown[0][1]
