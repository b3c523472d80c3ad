"""Surroundings of a frame in its recording: what supports, what else stands there, unknown objects, both ups."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.fakes import box_model, box_problem
from tests.recording.runs import recorded_run
from verefine_viz.core.surroundings import SupportSurface, Surroundings, UnknownObject
from verefine_viz.pictures.surroundings_meshes import drawn_surroundings
from verefine_viz.recording import entities
from verefine_viz.recording.recording_file import chunks_of

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
