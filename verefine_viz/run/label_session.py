"""The session in which the frames of a folder are labelled."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from verefine_viz.core.errors import InputError, one_line
from verefine_viz.core.frame_names import frame_name
from verefine_viz.core.settings import LABELLED, Session
from verefine_viz.run.data_folder import layout_fault
from verefine_viz.run.session_file import load_session
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.bop_files import inside_dataset, splits_to_open
from verefine_viz.scenes.labels import LABELS
from verefine_viz.scenes.layouts import recording_in


def label_session(folder: Path, models: Path | None, out: Path | None, overrides: Mapping[str, Any]) -> Session:
    """The session of a folder's frames and their labels.

    Args:
        folder: a data set in BOP layout, a split or a scene of it, or a folder as another program has it; it may lack
            ground truth, masks and models.
        models: folder of the meshes; None = the folder's own.
        out: folder of the file of labels; None = ``folder``.
        overrides: settings on top.

    Raises:
        VerefineError: the folder holds no frames that are read, or the settings do not fit.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; expected one with frames: a data set in BOP layout, traces, …")
    labels = (out or folder) / LABELS
    scene: dict[str, Any] = {"source": LABELLED, "dataset": str(folder.resolve()), "labels": str(labels.resolve())}
    if models is not None:
        scene["models"] = str(models.resolve())
    if recording_in(folder) is None:
        scene |= _of_bop(folder)
    given = {**overrides, "scene": {**scene, **overrides.get("scene", {})}}
    return load_session(None, {"title": one_line(folder.resolve().name), **given})


def _of_bop(folder: Path) -> dict[str, Any]:
    """Data set, split and frames that a folder is."""
    if splits := splits_to_open(folder):
        return {"split": splits[0]}
    inside = inside_dataset(folder)
    if inside is None:
        raise InputError(f"{folder} {layout_fault(folder)}")
    scene: dict[str, Any] = {"dataset": str(inside.dataset.resolve()), "split": inside.split}
    if inside.scene_id is not None:
        dataset = BopDataset(inside.dataset, inside.split, needs_models=False)
        scene["frames"] = tuple(frame_name((inside.scene_id, k)) for k in dataset.image_ids(inside.scene_id))
    return scene
