"""The labels of a folder while they are made: placed, searched for, snapped, judged, undone, carried on.

Each step is written at once (:class:`~verefine_viz.labels.label_folder.LabelFolder`).
"""

from __future__ import annotations

import getpass
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import takewhile
from pathlib import Path

import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.frame_names import frame_name, parse_frame
from verefine_viz.core.problem import Placed
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.text_format import listed
from verefine_viz.evaluation.proposed_symmetries import ProposedSymmetry, proposed_symmetries
from verefine_viz.labels.bop_writing import TruthWritten, labels_to_write, write_into_dataset, write_new_dataset
from verefine_viz.labels.carrying import CarriedFrame, carried_on
from verefine_viz.labels.label_folder import LabelFolder
from verefine_viz.labels.marked_region import region_of_box, region_of_scribble
from verefine_viz.labels.object_search import FoundPose, found
from verefine_viz.labels.placing import placed_by_click
from verefine_viz.labels.snapping import ALL_TURNS_DEG, TURNS_DEG, snapped
from verefine_viz.labels.verification import label_of
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.labelled_source import LabelledSource
from verefine_viz.scenes.labels import LABELS, Label, State, write_labels
from verefine_viz.scenes.unlabelled_frames import Models

Labels = tuple[Label, ...]


@dataclass(eq=False)
class _History:
    """Labels that a frame had; None = it had not been labelled."""

    past: list[Labels | None] = field(default_factory=list)
    future: list[Labels | None] = field(default_factory=list)


class LabelDesk:
    """Labels of the frames of a session, held until the desk is closed.

    Args:
        tools: the tools of a session whose ``scene.source`` is labels.
        progress: checked before anything that may take seconds.

    Raises:
        InputError: another program labels the folder, the file of labels is damaged, or the session is of something
            else.
    """

    def __init__(self, tools: Toolbox, progress: ProgressToken = NEVER_CANCELLED) -> None:
        self._source, self._tools, self._progress = _source_of(tools), tools, progress
        self.file = Path(tools.session.scene.labels)
        self._store = LabelFolder(self.file.parent)
        self._histories: dict[str, _History] = {}
        self._candidates: dict[tuple[str, int], tuple[FoundPose, ...]] = {}
        self._symmetries: dict[int, tuple[ProposedSymmetry, ...]] = {}

    def use(self, tools: Toolbox) -> None:
        """Go on with other tools of the same folder."""
        self._source, self._tools = _source_of(tools), tools

    def close(self) -> None:
        """Let other programs label the folder."""
        self._store.close()

    # What exists

    @property
    def models(self) -> Models:
        """Models that can be placed."""
        return self._source.bare.models

    @property
    def export_folder(self) -> str:
        """The data set into which ground truth is written unless another folder is named; "" = it needs one."""
        dataset = self._source.bare.dataset
        return "" if dataset is None else str(dataset.folder)

    @property
    def frames(self) -> Mapping[str, Labels]:
        """The labels of all frames that were labelled."""
        return self._store.frames

    def labels(self, frame: str) -> Labels:
        """The labels of a frame, in the order of their instances."""
        return self._store.labels(frame)

    def label(self, frame: str, instance: int) -> Label:
        """A label of a frame.

        Raises:
            InputError: it has none of that number.
        """
        for one in self.labels(frame):
            if one.instance == instance:
                return one
        raise InputError(unknown("label", instance, [one.instance for one in self.labels(frame)]))

    def candidates(self, frame: str, instance: int) -> tuple[FoundPose, ...]:
        """Candidate poses of a label, the best first; none for a label that was placed by a click."""
        return self._candidates.get((frame, instance), ())

    def can_undo(self, frame: str) -> bool:
        """Whether anything was done to a frame."""
        return bool(self._history(frame).past)

    def can_redo(self, frame: str) -> bool:
        """Whether anything was undone in a frame."""
        return bool(self._history(frame).future)

    def symmetries(self, obj_id: int) -> tuple[ProposedSymmetry, ...]:
        """Symmetries to propose for an object; the first call takes about a second."""
        if obj_id not in self._symmetries:
            self._symmetries[obj_id] = proposed_symmetries(self.models.get(obj_id), self._progress)
        return self._symmetries[obj_id]

    # Steps

    def place(self, frame: str, obj_id: int, u: float, v: float) -> Label:
        """Place an object where the photo was clicked and snap it: at the best pose found there, else upright.

        Raises:
            InputError: there is no such object, or no depth there.
        """
        try:
            return self.find(frame, obj_id, scribble=[(u, v)])
        except InputError:
            T = placed_by_click(self._source.observation(frame), self.models.get(obj_id), u, v)
            return self._snapped(frame, self._next(frame), obj_id, T, "placed", ALL_TURNS_DEG)

    def find(
        self,
        frame: str,
        obj_id: int,
        box: Sequence[float] | None = None,
        scribble: Sequence[tuple[float, float]] = (),
    ) -> Label:
        """Search for an object in a box, or on a scribble, and snap the best pose; others stay as candidates.

        Args:
            frame: name of the frame.
            obj_id: the object.
            box: left, top, right, bottom [px].
            scribble: (u, v) of its points [px].

        Raises:
            InputError: there is no such object, nothing stands there, or no pose fits.
        """
        model, observation, number = self.models.get(obj_id), self._source.observation(frame), self._next(frame)
        self._progress.checkpoint(f"Searching for {model.name}.")
        others = self.others(frame, number)
        if box is not None:
            region = region_of_box(observation, box, others)
        else:
            region = region_of_scribble(observation, np.array(scribble), model.diameter_m, others)
        poses = found(self._tools, observation, model, number, region, others, progress=self._progress)
        if not poses:
            raise InputError(f"{model.name} does not fit there; choose another place, or another model")
        label = self._snapped(frame, number, obj_id, poses[0].T_cam_obj, "estimated", (0.0,))
        self._candidates[frame, number] = poses
        return label

    def snap(self, frame: str, instance: int, T_cam_obj: Float) -> Label:
        """Snap a label from a pose (4, 4) that a person gave.

        Raises:
            InputError: there is no such label.
        """
        before = self.label(frame, instance)
        return self._snapped(frame, instance, before.obj_id, T_cam_obj, "given", TURNS_DEG)

    def decide(self, frame: str, instance: int, state: State, note: str = "") -> None:
        """Accept a label, mark it as uncertain, or leave it open.

        Raises:
            InputError: there is no such label.
        """
        at = datetime.now().isoformat(timespec="seconds")
        before = self.label(frame, instance)
        self._put(frame, structs.replace(before, state=state, note=note, by=getpass.getuser(), at=at))

    def remove(self, frame: str, instance: int) -> None:
        """Remove a label.

        Raises:
            InputError: there is no such label.
        """
        gone = self.label(frame, instance)
        self._change(frame, [one for one in self.labels(frame) if one is not gone] or None)

    def undo(self, frame: str, redo: bool = False) -> None:
        """Undo the last step on a frame, or redo it.

        Raises:
            InputError: there is none.
        """
        history = self._history(frame)
        there, back = (history.future, history.past) if redo else (history.past, history.future)
        if not there:
            raise InputError("nothing is left to redo" if redo else "nothing is left to undo")
        before = self.frames.get(frame)
        self._store.replace_all(frame, there[-1])
        there.pop()
        back.append(before)

    def carry(self, frame: str, most: int) -> Iterator[CarriedFrame]:
        """Carry the labels of a frame to the frames after it in its scene that have none, until one needs a person.

        Raises:
            InputError: it has no labels, or no such frame follows.
            Cancelled: it is no longer wanted; labels carried so far stay.
        """
        labels, scene = self.labels(frame), parse_frame(frame)[0]
        if not labels:
            raise InputError(f"frame {frame} has no labels to carry on; label it first")
        after = self._source.frames[self._source.frames.index(frame) + 1 :]
        names = [*takewhile(lambda name: parse_frame(name)[0] == scene and name not in self.frames, after)][:most]
        if not names:
            raise InputError(f"after frame {frame} no frame without labels follows in its scene")
        for step in carried_on(self._tools, self._source.bare, [frame, *names], labels, self._progress):
            self._change(step.frame, step.labels)
            yield step

    def export(self, out: Path | None, with_uncertain: bool, symmetric: Sequence[int], overwrite: bool) -> TruthWritten:
        """Write labels as the ground truth of a BOP data set.

        Args:
            out: folder of a data set of its own; None = into the data set that the frames are of.
            with_uncertain: whether uncertain ones count.
            symmetric: objects whose proposed symmetries were confirmed.
            overwrite: whether existing files are moved aside.

        Raises:
            InputError: there is nothing to write, a file exists already, or cannot be written.
        """
        labels = labels_to_write(self.frames, with_uncertain)
        left_out = [
            f"{frame} {label.name} ({label.state})"
            for frame, of in self.frames.items()
            for label in of
            if label not in labels.get(parse_frame(frame), ())
        ]
        confirmed = {obj_id: self.symmetries(obj_id) for obj_id in symmetric}
        bare, progress = self._source.bare, self._progress
        if out is None:
            written = write_into_dataset(bare, labels, confirmed, overwrite, progress)
        else:
            written = write_new_dataset(bare, labels, out, confirmed, overwrite, progress)
            write_labels(out / LABELS, dict(self.frames))  # With lights and widths, by which users may filter.
        red = [f"{frame_name(ids)} {one.name}" for ids, of in labels.items() for one in of if one.light == "red"]
        notes = [f"written though not verified: {listed(red)}"] if red else []
        notes += [f"left out: {listed(left_out)}"] if left_out else []
        return replace(written, notes=(*written.notes, *notes))

    def others(self, frame: str, instance: int) -> tuple[Placed, ...]:
        """The other labelled objects of a frame, without those whose light is red or whose model is gone."""
        others = (one for one in self.labels(frame) if one.instance != instance)
        there = (one for one in others if one.light != "red" and one.obj_id in self.models.ids)
        return tuple(Placed(one.instance, self.models.get(one.obj_id), one.pose) for one in there)

    def _snapped(
        self, frame: str, instance: int, obj_id: int, T_cam_obj: Float, begun: str, turns_deg: Sequence[float]
    ) -> Label:
        began = time.perf_counter()
        self._progress.checkpoint(f"Snapping {self.models.name(obj_id)}.")
        proposed = Placed(instance, self.models.get(obj_id), T_cam_obj)
        others = self.others(frame, instance)
        observation = self._source.observation(frame)
        snap = snapped(self._tools, observation, proposed, others, turns_deg)
        if begun != "given" and snap.rivals and snap.rivals[0].gain > 0:  # Its rotation was left to the search.
            proposed = replace(proposed, T_cam_obj=snap.rivals[0].T_cam_obj)
            snap = snapped(self._tools, observation, proposed, others, (0.0,))
        label = label_of(self._tools, snap, begun, time.perf_counter() - began)
        self._put(frame, label)
        return label

    def _next(self, frame: str) -> int:
        return self._store.next_instance(frame)

    def _put(self, frame: str, label: Label) -> None:
        others = [one for one in self.labels(frame) if one.instance != label.instance]
        self._change(frame, [*others, label])

    def _change(self, frame: str, labels: Sequence[Label] | None) -> None:
        before, history = self.frames.get(frame), self._history(frame)
        self._store.replace_all(frame, labels)
        history.past.append(before)
        history.future.clear()

    def _history(self, frame: str) -> _History:
        return self._histories.setdefault(frame, _History())


def _source_of(tools: Toolbox) -> LabelledSource:
    if not isinstance(tools.source, LabelledSource):
        raise InputError("these frames are not open to be labelled; open them by verefine-viz label FOLDER")
    return tools.source
