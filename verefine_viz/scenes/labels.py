"""Labels: poses of the objects in frames without ground truth, with what verifies each; and the file of them.

A label made by a person is refined, rests on its support and states what is undetermined (docs/methods.md 9). The file
``labels.json`` is the record of the work: it is read to go on with it, and has who made which pose how.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct, to_builtins

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, SettingsError, ShapeError
from verefine_viz.core.files import read_json
from verefine_viz.core.frame_names import frame_name, parse_frame
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.writing import write_json

LABELS = "labels.json"
VERSION = 1

Light = Literal["green", "amber", "red"]
State = Literal["proposed", "accepted", "uncertain"]
Pose16 = Annotated[tuple[float, ...], Meta(min_length=16, max_length=16)]


class Label(Struct, frozen=True, forbid_unknown_fields=True):
    """The pose of one object of a frame, and what verifies it."""

    instance: Annotated[int, Meta(ge=0, le=100_000)]
    """Which object of its frame; numbers are not used again within a frame."""
    obj_id: Annotated[int, Meta(ge=0)]
    name: str
    T_cam_obj: Pose16
    """By rows [m]."""
    light: Light
    """green: verified; amber: verified but for what the reasons say; red: something speaks against it."""
    reasons: tuple[str, ...] = ()
    """Each short and about the data: "turn about z ±14°: not seen"."""
    state: State = "proposed"
    """What the person decided."""
    note: str = ""
    """What the person noted about an uncertain one."""
    score: float = 0.0
    """In [0, 1] (Eq. 1)."""
    fit_mm: float = 0.0
    """Mean distance of measured depth to the model where both see the object [mm]."""
    seen: float = 0.0
    """Share of the drawn object that measured depth shows, in [0, 1]."""
    sinks_mm: float = 0.0
    """How deep it sinks into its support or a neighbour [mm]."""
    undetermined_mm: float = 0.0
    """The furthest shift that the image does not tell apart [mm]."""
    undetermined_deg: float = 0.0
    """The furthest turn [deg]; 180 about an axis of symmetry."""
    begun: str = "placed"
    """Where its pose began: placed, estimated, given (by a person, or a call), or carried from a frame."""
    refiner: str = ""
    by: str = ""
    """Who accepted it."""
    at: str = ""
    """When that was, as 2026-01-31T12:00:00."""
    seconds: float = 0.0
    """The program's own time for it [s]."""

    @property
    def pose(self) -> Float:
        """(4, 4) T_cam_obj [m]."""
        return np.reshape(self.T_cam_obj, (4, 4))


class LabelsFile(Struct, frozen=True, forbid_unknown_fields=True):
    """What ``labels.json`` holds."""

    version: Literal[1]
    frames: dict[str, tuple[Label, ...]]
    """By "scene/image"; a frame with an empty list was looked at and holds nothing."""


def read_labels(path: Path) -> dict[str, tuple[Label, ...]]:
    """The labels of a file by frame; none where there is no file.

    Raises:
        InputError: it is damaged, names no frame, has an instance twice, or a pose that is none.
    """
    if not path.exists():
        return {}
    frames: dict[str, tuple[Label, ...]] = {}
    for frame, labels in read_json(path, LabelsFile).frames.items():
        try:
            name = frame_name(parse_frame(frame))
            for label in labels:
                as_rigid(label.pose, f"frame {name}, instance {label.instance}")
        except (SettingsError, ShapeError) as error:
            raise InputError(f"{path}: {error}") from None
        numbers = [label.instance for label in labels]
        if len({*numbers}) < len(numbers):
            raise InputError(f"{path}: frame {name} has two labels of one instance; remove one of them")
        frames[name] = labels
    return frames


def write_labels(path: Path, frames: dict[str, tuple[Label, ...]]) -> None:
    """Write all labels, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    ordered = dict(sorted(frames.items(), key=lambda item: parse_frame(item[0])))
    write_json(path, to_builtins(LabelsFile(VERSION, ordered)))
