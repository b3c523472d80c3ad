"""Which frames of a data set are to be solved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from verefine_viz.core.errors import InputError
from verefine_viz.core.frame_names import FrameIds, frame_name, parse_frame
from verefine_viz.core.text_format import listed
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.frame_lists import listed_frames


def named_frames(dataset: BopDataset, frames: Sequence[str]) -> tuple[tuple[FrameIds, ...], tuple[str, ...]]:
    """The frames that ``scene.frames`` names, one by one or as lists, each once; and notes: about those that it names
    more often, and about those of a list that are not on the disk.

    Raises:
        SettingsError: a name is neither "scene/image" nor that of a list.
        InputError: the data set has no such scene or image, or no frame of a list.
    """
    named: list[FrameIds] = []
    notes: tuple[str, ...] = ()
    for frame in frames:
        if is_list(frame):
            of_list, own = listed_frames(dataset, frame)
            named += of_list
            notes += own
        else:
            named.append(parse_frame(frame))
            dataset.check(*named[-1])
    return tuple(dict.fromkeys(named)), repeated_notes(map(frame_name, named)) + notes


def is_list(frame: str) -> bool:
    """Whether an entry of ``scene.frames`` names a list of frames (:mod:`verefine_viz.scenes.frame_lists`)."""
    return "/" not in frame


def repeated_notes(frames: Iterable[str]) -> tuple[str, ...]:
    """A note about frames that are named more than once."""
    often = [frame for frame, n in Counter(frames).items() if n > 1]
    if not often:
        return ()
    is_one = len(often) == 1
    return (
        f"scene.frames names {'frame' if is_one else 'frames'} {listed(often)} more than once; "
        f"{'it' if is_one else 'each'} counts once",
    )


def frames_of_scene(dataset: BopDataset, scene_id: int) -> tuple[FrameIds, ...]:
    """The frames of a scene that the targets file names and that are on the disk, else all of the scene.

    Raises:
        InputError: no such scene, or one of the files is damaged.
    """
    every = tuple((scene_id, im_id) for im_id in dataset.image_ids(scene_id))
    asked = [ids for ids in dataset.targets or () if ids in every]
    return tuple(asked) or every


def all_frames(dataset: BopDataset) -> tuple[tuple[FrameIds, ...], tuple[str, ...]]:
    """All frames of the targets file that are on the disk, else all of the split; and notes about those that are not.

    Raises:
        InputError: the split holds no image.
    """
    targets = dataset.targets
    if targets:
        there = tuple(ids for ids in targets if dataset.has(*ids))
        missing = len(targets) - len(there)
        if there:
            note = f"{missing} of {len(targets)} frames of the targets file are not on the disk; they are left out"
            return there, (note,) if missing else ()
    every = dataset.frames
    if not every:
        why = next(iter(dataset.scene_notes()), "")
        raise InputError(
            f"{dataset.folder / dataset.split} lists no image in its scene_camera.json files{f': {why}' * bool(why)}"
        )
    return every, ()
