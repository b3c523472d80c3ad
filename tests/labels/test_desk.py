"""A folder that is labelled step by step: what a click and a box give, what is written, undone, carried, exported."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.labels.labelled import bare_dataset, problems
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Problem
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.labels.desk import LabelDesk
from verefine_viz.run.label_session import label_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.labels import Label, read_labels
from verefine_viz.scenes.segments import silhouette

FRAME = "3/0"


@pytest.fixture(scope="module")
def made() -> list[Problem]:
    return problems()


@pytest.fixture
def desk(tmp_path: Path, made: list[Problem]) -> Iterator[LabelDesk]:
    folder = bare_dataset(tmp_path / "boxes", made)
    desk = LabelDesk(Toolbox(label_session(folder, None, None, {"physics": {"collider": "hull"}})))
    yield desk
    desk.close()


def middle(problem: Problem, obj_id: int) -> tuple[float, float]:
    """(u, v) in the middle of what is seen of an object."""
    i = next(i for i in problem.instances if i.obj_id == obj_id)
    v, u = np.nonzero(i.mask)
    return float(np.median(u)), float(np.median(v))


def off(problem: Problem, label: Label) -> float:
    """ADD(-S) of a label to the truth, as a share of the diameter."""
    i = next(i for i in problem.instances if i.obj_id == label.obj_id)
    model = problem.models[label.obj_id]
    assert i.T_cam_obj_gt is not None
    # Cans and cartons look alike after turns that the made-up models do not declare.
    turns = [transform(axis_angle(np.array([0, 0, 1.0]), k * np.pi / 8), np.zeros(3)) for k in range(16)]
    flips = [transform(axis_angle(np.array(axis, float), np.pi), np.zeros(3)) for axis in ((1, 0, 0), (0, 1, 0))]
    alike = [*turns, *flips, *(f @ t for f in flips for t in turns)]
    return min(add_s_mm(model, label.pose @ S, i.T_cam_obj_gt) for S in alike) / (1e3 * model.diameter_m)


def test_a_click_on_each_object_labels_a_frame(desk: LabelDesk, made: list[Problem]) -> None:
    for obj_id in desk.models.ids:
        label = desk.place(FRAME, obj_id, *middle(made[0], obj_id))
        assert off(made[0], label) < 0.1
        assert label.fit_mm < 5
        assert label.light != "red"
        desk.decide(FRAME, label.instance, "accepted")
    written = read_labels(desk.file)[FRAME]
    assert [one.state for one in written] == ["accepted", "accepted"]
    assert len({one.instance for one in written}) == 2
    assert all(one.by and one.at for one in written)


def test_each_step_is_written_and_can_be_undone_without_end(desk: LabelDesk, made: list[Problem]) -> None:
    obj_id = desk.models.ids[0]
    v, u = np.nonzero(next(i.mask for i in made[0].instances if i.obj_id == obj_id))
    label = desk.find(FRAME, obj_id, box=(u.min(), v.min(), u.max() + 1, v.max() + 1))
    assert desk.candidates(FRAME, label.instance)
    desk.decide(FRAME, label.instance, "uncertain", "the print cannot be read")
    assert read_labels(desk.file)[FRAME][0].note == "the print cannot be read"
    moved = desk.snap(FRAME, label.instance, transform(np.eye(3), [0, 0, 0.005]) @ label.pose)
    assert moved.state == "proposed"
    states = [desk.labels(FRAME)]
    while desk.can_undo(FRAME):
        desk.undo(FRAME)
        states.append(desk.labels(FRAME))
    assert states[-1] == ()
    assert FRAME not in read_labels(desk.file)
    for before in reversed(states[:-1]):
        desk.undo(FRAME, redo=True)
        assert desk.labels(FRAME) == before
    assert not desk.can_redo(FRAME)
    desk.remove(FRAME, label.instance)
    assert desk.labels(FRAME) == ()
    with pytest.raises(InputError, match="unknown label"):
        desk.snap(FRAME, label.instance, moved.pose)


def test_labels_are_carried_to_frames_that_have_none_and_exported(desk: LabelDesk, made: list[Problem]) -> None:
    with pytest.raises(InputError, match="no labels to carry"):
        next(desk.carry(FRAME, 10))
    for i in made[0].instances:
        assert i.T_cam_obj_gt is not None
        u, v = middle(made[0], i.obj_id)
        label = desk.place(FRAME, i.obj_id, u, v)
        desk.decide(FRAME, label.instance, "accepted")
    (step,) = desk.carry(FRAME, 10)
    assert step.frame == "3/1"
    assert step.frame in read_labels(desk.file)
    with pytest.raises(InputError, match="without labels follows"):
        next(desk.carry(FRAME, 10))
    out = desk.file.parent.parent / "exported"
    written = desk.export(out, False, (), False)
    assert written.n_objects >= 2
    entries = BopDataset(out, "test").ground_truth(3, 0)
    assert entries is not None
    for entry, label in zip(entries, desk.labels(FRAME), strict=True):
        np.testing.assert_allclose(entry.T_cam_obj, label.pose, atol=1e-9)
        model, camera = made[0].models[entry.obj_id], made[0].observation.camera
        mask = BopDataset(out, "test").mask(3, 0, entry.gt_id, "mask", camera.shape)
        assert np.count_nonzero(mask ^ silhouette(model, label.pose, camera)) < 0.02 * mask.sum()
    with pytest.raises(InputError):
        desk.export(out, False, (), False)  # What is there stays.


def test_nothing_is_placed_where_there_is_no_depth_and_nothing_else_changes(desk: LabelDesk) -> None:
    with pytest.raises(InputError, match="outside of the image"):
        desk.place(FRAME, desk.models.ids[0], 1e5, 10)
    assert desk.labels(FRAME) == ()
    assert not desk.can_undo(FRAME)
