"""The frozen types: shapes are checked, arrays are copied and cannot be written."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fakes import box_model, box_problem
from verefine_viz.core.arrays import frozen
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, ShapeError, unknown
from verefine_viz.core.problem import DependencyGraph, Edge
from verefine_viz.core.scores import Scores
from verefine_viz.core.text_format import first_of, listed
from verefine_viz.recording.verify import differences, first_difference


def test_frozen_arrays_are_copies_and_read_only() -> None:
    mine = np.zeros(3)
    kept = frozen(mine, "x", (3,))
    mine[0] = 5
    assert kept[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 1
    assert frozen(kept, "x", (None,)) is kept


@given(st.floats(50, 2000), st.floats(50, 2000), st.floats(0.1, 3.0), st.integers(0, 63), st.integers(0, 47))
def test_back_projection_and_projection_are_inverse(fx, fy, z, u, v) -> None:  # type: ignore[no-untyped-def]
    camera = Camera(np.array([[fx, 0, 31.3], [0, fy, 22.8], [0, 0, 1]]), 64, 48)
    depth = np.zeros((48, 64))
    depth[v, u] = z
    point = camera.back_project(depth)[v, u]
    assert point[2] == z
    assert np.allclose(camera.project(point), [u, v], atol=1e-9)
    assert camera.back_project(depth).sum() == pytest.approx(point.sum())


@pytest.mark.parametrize(
    ("K", "size"),
    [
        (np.diag([0.0, 1, 1]), (4, 4)),
        (np.eye(3), (0, 4)),
        (np.eye(4), (4, 4)),
        (np.full((3, 3), np.inf), (4, 4)),
    ],
)
def test_impossible_cameras_are_refused(K: np.ndarray, size: tuple[int, int]) -> None:
    with pytest.raises(ShapeError):
        Camera(K, *size)


def test_broken_models_are_refused() -> None:
    model = box_model()
    for broken in (
        {"faces": np.zeros((0, 3), int)},
        {"faces": model.faces + 1},
        {"vertices": model.vertices * np.nan},
        {"diameter_m": 0.0},
    ):
        with pytest.raises(ShapeError):
            replace(model, **broken)


def test_the_mesh_hash_follows_the_geometry_alone() -> None:
    model = box_model()
    assert replace(model, name="other", obj_id=7).mesh_hash == model.mesh_hash
    assert replace(model, vertices=model.vertices * 1.001).mesh_hash != model.mesh_hash


def test_a_problem_can_be_narrowed_to_some_instances() -> None:
    problem = box_problem(2, 3)
    assert [i.instance_id for i in problem.only([2, 0]).instances] == [0, 2]
    assert problem.only([1]).observation is problem.observation
    with pytest.raises(InputError, match=r"instance 7; .*0/1"):
        problem.only([7])
    assert problem.targets[0] is problem.targets[0]


def test_scores_without_a_number_are_zero() -> None:
    one = np.ones(2)
    whole = np.ones(2, np.int64)
    scores = Scores(np.array([np.nan, 0.5]), one, one, whole, whole, np.tile([1, 2, 3, 4, 0], (2, 1)))
    assert scores.score.tolist() == [0.0, 0.5]
    assert scores[1].shares == {"explained": 0.1, "missed": 0.2, "protruding": 0.3, "hidden": 0.4, "unknown": 0.0}
    assert len(scores) == 2


def test_the_first_difference_is_named() -> None:
    a = box_problem(2).instances[0].hypotheses[0]
    assert first_difference(a, a) is None
    assert (first_difference(a, replace(a, confidence=0.1)) or "").startswith("confidence")
    T = np.array(a.T_cam_obj)
    T[0, 3] = np.nextafter(T[0, 3], 1)
    assert (first_difference((a,), (replace(a, T_cam_obj=T),)) or "").startswith("[0].T_cam_obj")
    assert first_difference((a,), ()) == ": 1 entries against 0"
    assert first_difference(float("nan"), float("nan")) is None
    assert first_difference(1, "1") == "record: int against str"


def test_a_difference_shows_digits_that_differ_and_how_much_they_do() -> None:
    a = np.eye(3)
    b = a.copy()
    b[1, 1], b[0, 2] = np.nextafter(1, 2), -0.0
    (found,) = differences(a, b, "R")
    assert found.words == ("R[1, 1]: 1.0 against 1.0000000000000002, by 2.2e-16, the largest of 2 differences in it")
    assert found.size == pytest.approx(2.2e-16, rel=0.01)
    assert [d.words for d in differences((1e6, 0.0), (1e6 + 1, -1e-3))] == [
        "[0]: 1000000.0 against 1000001.0, by 1",
        "[1]: 0.0 against -0.001, by 0.001",
    ]


@pytest.mark.parametrize(
    ("a", "b", "words"),
    [
        (np.array([1, 2]), np.array([1, 3]), "x[1]: 2 against 3"),
        (np.array([1.0, np.nan]), np.array([1.0, 2.0]), "x[1]: nan against 2.0"),
        (np.zeros(2), np.zeros(3), "x: float64 (2,) against float64 (3,)"),
        ("left", "right", "x: 'left' against 'right'"),
        (np.inf, 1.0, "x: inf against 1.0"),
    ],
)
def test_what_is_no_matter_of_digits_has_no_size(a: object, b: object, words: str) -> None:
    (found,) = differences(a, b, "x")
    assert (found.words, found.size) == (words, np.inf)


@pytest.mark.parametrize(
    ("name", "available", "meant"),
    [
        ("ipc", ["icp", "identity"], "icp"),
        ("ICP", ["icp"], "icp"),
        ("foo", ["icp", "identity"], None),
        ("50/2", ["50/1"], None),
        (99, range(1, 22), None),
    ],
)
def test_unknown_names_are_answered_with_those_that_exist(
    name: object, available: Sequence[object], meant: str
) -> None:
    said = unknown("thing", name, available)
    assert listed([*available]) in said
    assert ("did you mean" in said) == (meant is not None)
    assert meant is None or repr(meant) in said


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ([2, 5], "2, 5"),
        ([3, 1, 2, 8, 9, 11, 12, 13, 14], "1, 2, 3, 8, 9, 11-14"),
        ([7], "7"),
        (range(0, 300, 2), ", ".join(map(str, range(0, 52, 2))) + ", … (150 in all)"),
        ([*range(1, 3000), 4000], "1-2999, 4000"),
        (["0/0", "0/1", "0/2"], "0/0, 0/1, 0/2"),
        ([f"50/{k}" for k in range(100, 999)], ", ".join(f"50/{k}" for k in range(100, 127)) + ", … (899 in all)"),
        (["x" * 300, "y"], "x" * 300 + ", … (2 in all)"),
        (["x" * 300], "x" * 300),
    ],
)
def test_long_lists_are_cut(names: Iterable[object], said: str) -> None:
    assert listed(names) == said


def test_of_many_names_the_first_are_reported_and_how_many_more_there_are() -> None:
    assert first_of([], 2) == ""
    assert first_of(["a", "b"], 2) == "a, b"
    assert first_of(["a", "b", "c"], 2) == "a, b and 1 more"
    assert first_of(["a", "b", "c"], 2, " or ") == "a or b and 1 more"
    assert first_of(["a moved", "b fell", "c moved"], 2, "; ") == "a moved; b fell; and 1 more"


GRAPH = DependencyGraph(
    (Edge("support", 3, 1, 0.8, "64 % of its footprint"), Edge("occlusion", 2, 3, 0.4, "22 mm nearer")),
    ((3, 1, 2), (4,)),
    ((3, 1), (2,), (4,)),
    "recommended",
)


@given(st.sets(st.integers(1, 4)))
def test_a_graph_of_fewer_instances_keeps_their_order_and_the_edges_among_them(kept: set[int]) -> None:
    assert (GRAPH.order, [GRAPH.cluster_of(i) for i in (1, 2, 3, 4)]) == ((3, 1, 2, 4), [0, 0, 0, 1])
    graph = GRAPH.only(kept)
    assert graph.order == tuple(i for i in GRAPH.order if i in kept)
    assert all(graph.clusters)
    assert all(graph.support_lists)
    assert set(graph.edges) == {e for e in GRAPH.edges if {e.first, e.second} <= kept}
