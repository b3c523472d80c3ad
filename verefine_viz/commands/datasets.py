"""``verefine-viz datasets``: the paper's data sets, how to get them, and whether a folder can be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from verefine_viz.core.errors import SettingsError, UnavailableError, one_line, unknown
from verefine_viz.core.text_format import say
from verefine_viz.core.writing import check_folder

HUB = "https://huggingface.co/datasets/bop-benchmark"


@dataclass(frozen=True)
class PublicDataset:
    """A data set of the paper: what to fetch, and from where."""

    name: str
    title: str
    used_for: str
    archives: tuple[str, ...] = ()
    """Archives on the BOP hub; the first holds the data set's folder, the others unpack into it."""
    instructions: str = ""
    """How to get it where it is not on the hub."""
    notes: tuple[str, ...] = ()


AUTHORS = "the archive that the README of github.com/dornik/verefine links"
"""What the authors of VeREFINE made of the data sets."""
DENSEFUSION = "official weights of DenseFusion: github.com/j96w/DenseFusion, Trained checkpoints"
CATALOGUE = (
    PublicDataset(
        "lm",
        "LINEMOD",
        "13 objects (3 and 7 are left out), one annotated object per frame, 2219 frames of BOP'19",
        ("lm_base.zip", "lm_models.zip", "lm_test_bop19.zip"),
        notes=(
            'frames of the paper: scene.frames = "linemod-paper", as in sessions/lm.toml and lm_densefusion.toml',
            f"the authors' own list is bop/lm/test_targets_verefine.json of {AUTHORS}: put it beside "
            "test_targets_bop19.json, and scene.frames takes its name",
            DENSEFUSION,
        ),
    ),
    PublicDataset(
        "lmo",
        "LINEMOD-Occluded",
        "the clutter of LINEMOD: 8 objects of scene 2, all annotated (not in the paper)",
        ("lmo_base.zip", "lmo_models.zip", "lmo_test_bop19.zip"),
    ),
    PublicDataset(
        "ycbv",
        "YCB-Video",
        "21 objects, 75 key frames of each of 12 test scenes, the 900 frames of BOP'19",
        ("ycbv_base.zip", "ycbv_models.zip", "ycbv_test_bop19.zip"),
        notes=(
            'frames of the paper: scene.frames = "ycbv-keyframes", as in sessions/ycbv_densefusion.toml',
            "models 0.5 GB, test_bop19 0.7 GB; poses for the original YCB-Video models need the offsets of "
            "dataset_info.md",
            DENSEFUSION,
        ),
    ),
    PublicDataset(
        "xapc",
        "Extended APC",
        "11 objects, three in each of 30 scenes, which touch or carry each other; all frames",
        instructions=f"not on the hub: bop/xapc of {AUTHORS} is in BOP layout",
        notes=(
            "as its authors publish it (xapc/scene-0001/gt_info.yml, frame-000000.depth.png, …): view and batch "
            "open xapc, import makes BOP layout of it; the README of github.com/cmitash/PhysimGlobalPose links the "
            "models, which go to xapc/models/NAME/",
            "its dependency lists are the order of the objects, and its camera poses say what is down",
        ),
    ),
)


@dataclass(frozen=True)
class Datasets:
    """List the paper's data sets (datasets), check a folder (datasets check DIR), or fetch (datasets fetch NAME)."""

    action: Annotated[Literal["list", "check", "fetch"], tyro.conf.Positional] = "list"
    """list: what there is and how to get it. check: which parts a folder has, what can be run, what is wrong; the
    exit code is 1 where a part needs a look (it is damaged, wrong, or nothing can be solved without it), else 0: that a
    copy holds only some frames of its targets file is a note. fetch: download from the BOP hub."""
    what: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="[DIR|NAME]")] = ""
    """check: the data set's folder, or that of a split. fetch: the data set's name."""
    folder: Path = Path("datasets")
    """fetch: where the archives go; each data set is a folder in it."""
    sensor: str = ""
    """check: the sensor whose files are read, where scenes have several; by default the first with ground truth."""

    def run(self, arguments: Sequence[str]) -> int:
        if self.action == "list":
            return _list(self.folder)
        if not self.what:
            needed = "the folder to check" if self.action == "check" else "the name of a data set"
            raise SettingsError(f"datasets {self.action} needs {needed}")
        return _check(Path(self.what), self.sensor) if self.action == "check" else _fetch(self.what, self.folder)


def _list(folder: Path) -> int:
    from rich.text import Text

    from verefine_viz.core.console import Terminal

    console = Terminal()
    for entry in CATALOGUE:
        console.print(Text.assemble((entry.name, "bold"), f"  {entry.title}: {entry.used_for}"))
        for line in (*_fetch_instructions(entry, folder), *entry.notes):
            say(f"      {line}")
    say("verefine-viz datasets fetch NAME downloads; datasets check DIR checks what is there.")
    return 0


def _fetch(name: str, folder: Path) -> int:
    entry = next((entry for entry in CATALOGUE if entry.name == name), None)
    if entry is None:
        raise SettingsError(unknown("data set", name, [entry.name for entry in CATALOGUE]))
    for path in _download(entry, folder):
        say(path)
    say(_fetch_instructions(entry, folder)[-1])
    return 0


def _fetch_instructions(entry: PublicDataset, folder: Path) -> list[str]:
    """Instructions for users without huggingface_hub, line by line."""
    if not entry.archives:
        return [entry.instructions]
    first, *others = entry.archives
    into = folder / entry.name
    return [
        *(f"fetch {HUB}/{entry.name}/resolve/main/{archive}" for archive in entry.archives),
        f"unpack {first} in {folder} (it makes {into}), and {', '.join(others)} in {into}",
    ]


def _download(entry: PublicDataset, folder: Path) -> list[Path]:
    """Download the archives of a data set next to its folder; archives that exist are skipped.

    Raises:
        UnavailableError: huggingface_hub is not installed, the hub cannot be reached, or it does not have the data set.
        InputError: nothing can be written there.
    """
    by_hand = "; ".join(_fetch_instructions(entry, folder))
    if not entry.archives:
        raise UnavailableError(f"{entry.name} cannot be downloaded: {entry.instructions}")
    check_folder(folder, "--folder")
    try:
        from huggingface_hub import HfApi, hf_hub_download
    except ModuleNotFoundError as error:
        if error.name != "huggingface_hub":
            raise
        raise UnavailableError(
            f"downloading needs huggingface_hub: pip install 'verefine-viz[datasets]'; or by hand: {by_hand}"
        ) from None
    repository = f"bop-benchmark/{entry.name}"
    try:
        # Asked once before, because a download would try again and again for a minute.
        HfApi().dataset_info(repository, timeout=10)
        return [
            Path(hf_hub_download(repository, archive, repo_type="dataset", local_dir=folder))
            for archive in entry.archives
        ]
    except Exception as error:
        # The hub's client lets through what its HTTP library raises, and that has changed between versions.
        why = " ".join(str(error).split())[:120] or type(error).__name__
        raise UnavailableError(f"{repository} cannot be fetched from the hub ({why}); by hand: {by_hand}") from None


def _check(folder: Path, sensor: str) -> int:
    """Print what a check found; exit code 0 where no part needs attention, else 1."""
    from rich.markup import escape

    from verefine_viz.commands.dataset_check import check_split
    from verefine_viz.commands.dataset_parts import runnable_parts, splits_of
    from verefine_viz.core.console import Terminal, print_checks
    from verefine_viz.scenes.bop_files import inside_dataset

    console = Terminal()
    faulty: list[str] = []
    if inside := inside_dataset(folder):
        say(one_line(f"{folder} lies in the data set {inside.dataset}; its split {inside.split} is checked"))
    folder, splits = (inside.dataset, (inside.split,)) if inside else (folder, splits_of(folder))
    for split in splits:
        with console.status(f"checking {escape(split)}"):
            parts = check_split(folder, split, sensor)
        print_checks(f"{folder.name} {split}", "part", [row.cells for row in parts.findings])
        faulty += [row.name for row in parts.findings if row.advice]
        for what, missing in runnable_parts(parts):
            say(f"{'cannot' if missing else 'can'} run: {what}" + (f"; missing {missing}" * bool(missing)))
    if not faulty:
        say("No part needs a look: exit code 0.")
        return 0
    how_many = "1 part needs" if len(faulty) == 1 else f"{len(faulty)} parts need"
    say(f"{how_many} a look, hence exit code 1: {', '.join(faulty)}.")
    return 1
