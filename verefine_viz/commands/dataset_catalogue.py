"""The data sets of the paper: what to fetch, from where, and where to put it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from verefine_viz.core.errors import SettingsError, UnavailableError, unknown
from verefine_viz.core.paths import check_folder

HUB = "https://huggingface.co/datasets/bop-benchmark"


@dataclass(frozen=True)
class Entry:
    """A data set."""

    name: str
    title: str
    used_for: str
    archives: tuple[str, ...] = ()
    """Archives on the BOP hub; the first holds the data set's folder, the others unpack into it."""
    by_hand: str = ""
    """How to get it where it is not on the hub."""
    note: str = ""


CATALOGUE = (
    Entry(
        "lm",
        "LINEMOD",
        "13 objects (3 and 7 are left out), one annotated object per frame",
        ("lm_base.zip", "lm_models.zip", "lm_test_all.zip"),
        note="the paper solves 2219 of the frames; choose yours with scene.frames",
    ),
    Entry(
        "lmo",
        "LINEMOD-Occluded",
        "the clutter of LINEMOD: 8 objects of scene 2, all annotated",
        ("lmo_base.zip", "lmo_models.zip", "lmo_test_bop19.zip"),
    ),
    Entry(
        "ycbv",
        "YCB-Video",
        "21 objects, 12 test scenes, 900 frames in the benchmark's subset",
        ("ycbv_base.zip", "ycbv_models.zip", "ycbv_test_bop19.zip"),
        note="models 0.5 GB, test_bop19 0.7 GB; poses for the original YCB-Video models need the offsets of "
        "dataset_info.md",
    ),
    Entry(
        "xapc",
        "Extended APC",
        "objects in groups of three that touch or carry each other",
        by_hand="not in BOP layout on the hub: fetch frames and models from github.com/cmitash/PhysimGlobalPose and "
        "arrange them as xapc/models/obj_000001.ply (mm) and xapc/test/000001/{rgb,depth,mask_visib}/, "
        "scene_camera.json, scene_gt.json",
    ),
)


def entry(name: str) -> Entry:
    """The data set of that name.

    Raises:
        SettingsError: there is none.
    """
    for known in CATALOGUE:
        if known.name == name:
            return known
    raise SettingsError(unknown("data set", name, [e.name for e in CATALOGUE]))


def how_to_fetch(known: Entry, folder: Path) -> list[str]:
    """What to do by hand, a line each."""
    if not known.archives:
        return [known.by_hand]
    first, *others = known.archives
    into = folder / known.name
    return [
        *(f"fetch {HUB}/{known.name}/resolve/main/{archive}" for archive in known.archives),
        f"unpack {first} in {folder} (it makes {into}), and {', '.join(others)} in {into}",
    ]


def fetch(known: Entry, folder: Path) -> list[Path]:
    """Downloads the archives of a data set next to its folder; those that are there already are kept.

    Raises:
        UnavailableError: huggingface_hub is not installed, the hub cannot be reached, or it does not have the data set.
        InputError: nothing can be written there.
    """
    by_hand = "; ".join(how_to_fetch(known, folder))
    if not known.archives:
        raise UnavailableError(f"{known.name} cannot be downloaded: {known.by_hand}")
    check_folder(folder, "--folder")
    try:
        from huggingface_hub import HfApi, hf_hub_download
    except ModuleNotFoundError as error:
        if error.name != "huggingface_hub":
            raise
        raise UnavailableError(
            f"downloading needs huggingface_hub: pip install 'verefine-viz[datasets]'; or by hand: {by_hand}"
        ) from None
    repository = f"bop-benchmark/{known.name}"
    try:
        # Asked once before, because a download would try again and again for a minute.
        HfApi().dataset_info(repository, timeout=10)
        return [
            Path(hf_hub_download(repository, archive, repo_type="dataset", local_dir=folder))
            for archive in known.archives
        ]
    except Exception as error:
        # The hub's client lets through what its HTTP library raises, and that has changed between versions.
        why = " ".join(str(error).split())[:120] or type(error).__name__
        raise UnavailableError(f"{repository} cannot be fetched from the hub ({why}); by hand: {by_hand}") from None
