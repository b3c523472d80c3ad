"""Lists of frames by name: those of the paper's experiments, and the targets files of a data set."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from importlib import resources

from verefine_viz.core.errors import InputError, SettingsError, meant, quoted
from verefine_viz.core.frame_names import FrameIds
from verefine_viz.scenes.annotations import target_counts
from verefine_viz.scenes.bop import BopDataset


@dataclass(frozen=True)
class FrameList:
    """A part of the frames that a data set's targets file names."""

    scene_ids: Collection[int]
    n_frames: int
    """As many as the paper says."""
    leaves_out_training: bool = False
    """Whether frames of LINEMOD's training split are no part of it."""


FRAME_LISTS = {
    "linemod-paper": FrameList((1, 2, 4, 5, 6, *range(8, 16)), 2219, leaves_out_training=True),
    "ycbv-keyframes": FrameList(range(48, 60), 900),
}
"""Paper Sec. V: the frames of BOP'19; of LINEMOD without scenes 3 and 7 and without frames that networks train with."""


@cache
def linemod_training() -> frozenset[FrameIds]:
    """The training split of LINEMOD that Brachmann et al., BB8 (Rad and Lepetit, ICCV 2017) and Tekin et al. share,
    as the authors of BB8 list it: github.com/PofeiShit/BB8, data/LINEMOD/training_range.
    """
    text = (resources.files("verefine_viz.scenes") / "linemod_training.txt").read_text("utf-8")
    scenes = (line.split(":") for line in text.splitlines())
    return frozenset((int(scene_id), int(im_id)) for scene_id, ids in scenes for im_id in ids.split())


def listed_frames(dataset: BopDataset, name: str) -> tuple[tuple[FrameIds, ...], tuple[str, ...]]:
    """The frames of a list that are on the disk; and a note where they are fewer than the list has.

    Args:
        dataset: the data set.
        name: one of ``FRAME_LISTS``, or a targets file in the data set's folder.

    Raises:
        SettingsError: there is no list of that name.
        InputError: the targets file is missing or damaged, or no frame of the list is on the disk.
    """
    wanted, n_frames = _part(dataset, FRAME_LISTS[name]) if name in FRAME_LISTS else _targets(dataset, name)
    there = tuple(ids for ids in wanted if dataset.has(*ids))
    if not there:
        raise InputError(f"{dataset.folder / dataset.split} holds none of the frames of {name}")
    note = f"{len(there)} of the {n_frames} frames of {name} are on the disk; the others are left out"
    return there, (note,) if len(there) != n_frames else ()


def _part(dataset: BopDataset, part: FrameList) -> tuple[list[FrameIds], int]:
    """The frames of a part of the targets, and how many they should be."""
    if dataset.targets is None:
        raise InputError(
            f"{dataset.folder} has no targets file, of which scene.frames names a part; it is in the data set's base "
            "archive, as `verefine-viz datasets` lists it"
        )
    training = linemod_training() if part.leaves_out_training else frozenset[FrameIds]()
    return [ids for ids in dataset.targets if ids[0] in part.scene_ids and ids not in training], part.n_frames


def _targets(dataset: BopDataset, name: str) -> tuple[list[FrameIds], int]:
    """The frames of a targets file of that name, and their number."""
    lists = [*FRAME_LISTS, *sorted(path.name for path in dataset.folder.glob("*targets*.json"))]
    if name not in lists:
        raise SettingsError(
            f'frame {quoted(name)} is not "scene/image", such as "50/1", and no list of frames has that name; '
            f"{meant(name, lists)}available: {', '.join(lists)}"
        )
    wanted = list(target_counts(dataset.folder / name))
    return wanted, len(wanted)
