"""What windows get of the labels of a frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from verefine_viz.page.wire import Message, Part, Pose


class PlaceableModel(Part, frozen=True):
    """A model that can be placed."""

    obj_id: int
    name: str
    symmetry: str
    """What is proposed: "every turn about z"; "" = none, or not worked out yet."""


class CandidatePose(Part, frozen=True):
    """A pose that was searched for, the best first."""

    T: Pose
    score: float


class LabelShown(Part, frozen=True):
    """A label of the open frame."""

    obj: int
    """The instance, as of the frame's objects."""
    obj_id: int
    name: str
    T: Pose
    light: Literal["green", "amber", "red"]
    reasons: Sequence[str]
    state: Literal["proposed", "accepted", "uncertain"]
    note: str
    score: float
    fit_mm: float
    sinks_mm: float
    undetermined_mm: float
    undetermined_deg: float
    begun: str
    """placed, estimated, given, carried from 1/3."""
    seconds: float
    candidates: Sequence[CandidatePose]


class FrameLabels(Part, frozen=True):
    """What a frame of the folder has."""

    labels: int
    accepted: int
    undecided: int
    """Those still proposed."""
    light: Literal["green", "amber", "red"]
    """The worst of the undecided, and red where any label is; else green."""


class LabelsMessage(Message, frozen=True):
    """The labels of the open frame, and how far the folder is."""

    frame: str
    models: Sequence[PlaceableModel]
    labels: Sequence[LabelShown]
    frames: Mapping[str, FrameLabels]
    """Those that have some."""
    file: str
    """Where they are written."""
    undo: bool
    redo: bool
    export: str
    """The folder into which ground truth can be written: the data set itself, or one beside it."""
