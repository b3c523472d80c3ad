"""Symmetries that are proposed: those that shapes have, and none that they have nearly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.evaluation.test_near_symmetry import shape
from tests.made_up_frames import model
from verefine_viz.core.files import Numbered
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.writing import write_json
from verefine_viz.evaluation.bop_model import bop_symmetries
from verefine_viz.evaluation.proposed_symmetries import proposed_symmetries, symmetry_entry
from verefine_viz.scenes.models import ModelInfo, ModelLibrary


def test_a_box_has_its_three_half_turns_and_a_square_one_its_quarter_turns() -> None:
    for size, turns in (((0.1, 0.07, 0.04), 3), ((0.06, 0.06, 0.1), 7)):
        box = shape(trimesh.creation.box(size).subdivide().subdivide())
        proposed = proposed_symmetries(box)
        assert len(proposed) == turns, size
        for one in proposed:
            assert one.angle_deg in (90, 180)
            assert one.changes_mm < 0.2
            assert one.colors_differ is None
            assert one.looks_alike
            corners = box.vertices @ one.turns[0][:3, :3].T + one.turns[0][:3, 3]
            assert np.abs(np.abs(corners) - np.abs(corners).max(axis=0)).min(axis=1).max() < 1e-6  # On the box's sides.


def test_a_cylinder_that_stands_anywhere_turns_about_its_axis_and_the_files_entry_says_so(tmp_path: Path) -> None:
    tilt = axis_angle(np.array([1.0, 2.0, 0.5]), 0.7)
    where = transform(tilt, [0.02, -0.01, 0.03])
    can = shape(trimesh.creation.cylinder(0.03, 0.1, sections=96).subdivide(), where)
    proposed = proposed_symmetries(can)
    assert proposed[0].angle_deg is None
    assert abs(proposed[0].axis @ tilt[:, 2]) > np.cos(np.radians(0.5))
    off = proposed[0].centre_m - where[:3, 3]
    assert np.linalg.norm(np.cross(off, tilt[:, 2])) < 3e-4
    write_json(tmp_path / "models_info.json", {"1": symmetry_entry(proposed)})
    moved = bop_symmetries(Numbered(tmp_path / "models_info.json", ModelInfo, "object")[1], "here")
    assert len(moved) == 315 * (1 + len([one for one in proposed if one.angle_deg]))
    rim = (where[:3, :3] @ np.array([0.03, 0, 0.05]) + where[:3, 3]) * 1e3
    axis, middle = tilt[:, 2], where[:3, 3] * 1e3
    for T in moved[::20]:
        point = T[:3, :3] @ rim + T[:3, 3] - middle
        assert abs(np.linalg.norm(np.cross(point, axis)) - 30) < 1.0
        assert abs(abs(point @ axis) - 50) < 1.0


def test_a_handle_or_a_dent_is_no_symmetry_and_colours_are_measured() -> None:
    assert proposed_symmetries(model("mug")) == ()
    can = proposed_symmetries(model("can"))[0]
    assert (can.angle_deg, can.axis.tolist()) == (None, [0, 0, 1])
    assert 0 < can.changes_mm < 0.2
    assert can.looks_alike
    dented = trimesh.creation.box((0.1, 0.07, 0.04)).subdivide().subdivide().subdivide()
    dented.vertices[dented.vertices[:, 2] > 0.019] -= [0, 0, 0.004]
    dented.vertices[(dented.vertices[:, 2] > 0.015) & (dented.vertices[:, 0] > 0.02)] += [0, 0, 0.008]
    assert {one.angle_deg for one in proposed_symmetries(shape(dented))} <= {180.0}
    assert all(abs(one.axis[2]) < 0.5 and abs(one.axis[1]) < 0.5 for one in proposed_symmetries(shape(dented)))
    box = shape(trimesh.creation.box((0.1, 0.07, 0.04)).subdivide().subdivide())
    half = np.where(box.vertices[:, :1] > 0.001, 255, 0).astype(np.uint8).repeat(3, axis=1)
    painted = {tuple(np.abs(one.axis).round()): one for one in proposed_symmetries(replace(box, vertex_colors=half))}
    assert painted[1, 0, 0].looks_alike  # About x each half stays where it is.
    for axis in ((0, 1, 0), (0, 0, 1)):
        one = painted[axis]
        assert not one.looks_alike
        assert one.colors_differ is not None
        assert one.colors_differ > 0.5


@pytest.mark.usefixtures("long_run")
def test_what_ycbv_declares_is_proposed(shared_data: Path) -> None:
    models = ModelLibrary(shared_data / "ycbv", 500, 0, "random")
    proposed = {obj_id: proposed_symmetries(models.get(obj_id)) for obj_id in (13, 14, 16, 18, 21)}
    for obj_id in (13, 18):  # Declared as continuous.
        assert proposed[obj_id][0].angle_deg is None, obj_id
    assert sorted(one.angle_deg or 0 for one in proposed[16] if abs(one.axis[2]) > 0.99) == [90, 90, 180]
    assert [one.angle_deg for one in proposed[21]] == [180]
    assert proposed[14] == ()  # The mug.
