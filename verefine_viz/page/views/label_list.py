"""The labels of the open frame, and how far the folder is."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from verefine_viz.page.label_messages import CandidatePose, FrameLabels, LabelShown, LabelsMessage, PlaceableModel
from verefine_viz.page.wire import pose_numbers
from verefine_viz.scenes.labels import Label, Light

if TYPE_CHECKING:
    from verefine_viz.labels.desk import LabelDesk


def labels_message(desk: LabelDesk, frame: str) -> LabelsMessage:
    """Return the labels of a frame, the models that can be placed, and what other frames have."""
    return LabelsMessage(
        frame=frame,
        models=[_model(desk, obj_id, {label.obj_id for label in desk.labels(frame)}) for obj_id in desk.models.ids],
        labels=[_shown(desk, frame, label) for label in desk.labels(frame)],
        frames={name: _of_frame(labels) for name, labels in desk.frames.items() if labels},
        file=str(desk.file),
        undo=desk.can_undo(frame),
        redo=desk.can_redo(frame),
        export=desk.export_folder,
    )


def _model(desk: LabelDesk, obj_id: int, labelled: Collection[int]) -> PlaceableModel:
    symmetries = desk.symmetries(obj_id) if obj_id in labelled else ()
    return PlaceableModel(obj_id, desk.models.name(obj_id), "; ".join(one.describe() for one in symmetries))


def _shown(desk: LabelDesk, frame: str, label: Label) -> LabelShown:
    candidates = desk.candidates(frame, label.instance)
    return LabelShown(
        obj=label.instance,
        obj_id=label.obj_id,
        name=label.name,
        T=label.T_cam_obj,
        light=label.light,
        reasons=label.reasons,
        state=label.state,
        note=label.note,
        score=label.score,
        fit_mm=label.fit_mm,
        sinks_mm=label.sinks_mm,
        undetermined_mm=label.undetermined_mm,
        undetermined_deg=label.undetermined_deg,
        begun=label.begun,
        seconds=label.seconds,
        candidates=[CandidatePose(pose_numbers(one.T_cam_obj), one.score) for one in candidates],
    )


def _of_frame(labels: tuple[Label, ...]) -> FrameLabels:
    undecided = [label.light for label in labels if label.state == "proposed"]
    lights = [*undecided, *(label.light for label in labels if label.light == "red")]
    worst: Light = "red" if "red" in lights else "amber" if "amber" in lights else "green"
    return FrameLabels(len(labels), sum(label.state == "accepted" for label in labels), len(undecided), worst)
