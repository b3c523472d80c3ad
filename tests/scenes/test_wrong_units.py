"""Data of which a factor or the camera is another one are told from good data, and from single bad objects."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes.bop_folder import OBJ_IDS, Made, detections, image, make
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import transform
from verefine_viz.core.settings import HypothesesSettings
from verefine_viz.scenes.results_csv import ResultRow, write_results

NOWHERE = "depth in the objects' masks lies nowhere near their ground-truth poses"


def scaled_camera(factor: float) -> Callable[[Made], None]:
    def change(content: Any) -> None:
        K = content["3"]["cam_K"]
        content["3"]["cam_K"] = [K[0] * factor, 0, K[2] * factor, 0, K[4] * factor, K[5] * factor, 0, 0, 1]

    return lambda made: made.edit("scene_camera.json", change)


def scaled_truth(factor: float) -> Callable[[Made], None]:
    def change(content: Any) -> None:
        for entry in content["3"]:
            entry["cam_t_m2c"] = [factor * x for x in entry["cam_t_m2c"]]

    return lambda made: made.edit("scene_gt.json", change)


def without_rotations(content: Any) -> None:
    for entry in content["3"]:
        del entry["cam_R_m2c"]


def tenfold_depth(made: Made) -> None:
    made.edit("scene_camera.json", lambda content: content["3"].update(depth_scale=1.0))


@pytest.mark.parametrize(
    "break_it",
    [scaled_camera(0.5), scaled_camera(2), scaled_truth(1e-3), scaled_truth(0.1), tenfold_depth],
    ids=["half the camera", "twice the camera", "truth in m", "truth in cm", "depth tenfold"],
)
def test_data_that_do_not_belong_together_are_noted_once(tmp_path: Path, break_it: Callable[[Made], None]) -> None:
    made = make(tmp_path)
    assert made.read().notes == ()
    break_it(made)
    notes = [note for note in made.read().notes if NOWHERE in note]
    assert len(notes) == 1
    assert notes[0].endswith(f"so scores or errors are wrong; `verefine-viz datasets check {tmp_path}` shows more")


def test_one_mask_of_something_else_is_no_sign_of_wrong_data(tmp_path: Path) -> None:
    made = make(tmp_path)
    corner = np.zeros(made.problem.instances[0].mask.shape, np.uint8)
    corner[:8, :8] = 255
    image(made, "mask_visib/000003_000000.png", corner)
    assert not [note for note in made.read().notes if NOWHERE in note]


def test_a_single_detection_of_something_else_is_no_sign_of_wrong_data(tmp_path: Path) -> None:
    made = make(tmp_path)
    scaled_truth(0.1)(made)
    path = tmp_path / "detections.json"
    entries = detections(made)
    for n, is_noted in ((2, False), (3, True)):
        path.write_text(json.dumps(entries[:n]))
        assert any(NOWHERE in note for note in made.read(masks=str(path)).notes) == is_noted


def results(made: Made, folder: Path, change: Callable[[Float], Float], skip: Sequence[int] = ()) -> HypothesesSettings:
    """A results file of the ground-truth poses, ``change`` applied."""
    rows = []
    for k, (obj_id, T) in enumerate(zip(OBJ_IDS, made.truth, strict=True)):
        rows.append(ResultRow(7, 3, obj_id, 0.9 - 0.1 * k, T if k in skip else change(T)))
    write_results(folder / "est_x-test.csv", rows)
    return HypothesesSettings(source="results", files=(str(folder / "est_x-test.csv"),))


def in_units(factor: float) -> Callable[[Float], Float]:
    return lambda T: transform(T[:3, :3], factor * T[:3, 3])


CENTIMETRES = (
    "est_x-test.csv: every pose lies at about a tenth of the depth in its object's mask, so t looks like centimetres; "
    "BOP wants millimetres: multiply t by 10 (or depth_scale is 10 times too large)"
)


def test_translations_in_centimetres_are_noted(tmp_path: Path) -> None:
    made = make(tmp_path)
    assert CENTIMETRES in made.read(results(made, tmp_path, in_units(0.1))).notes
    # Also where nobody knows the truth.
    made.edit("scene_gt.json", without_rotations)
    assert CENTIMETRES in made.read(results(made, tmp_path, in_units(0.1))).notes


def test_other_distances_are_no_sign_of_centimetres(tmp_path: Path) -> None:
    made = make(tmp_path)
    for factor in (1.0, 0.5, 2.0):
        assert made.read(results(made, tmp_path, in_units(factor))).notes == ()


def test_one_pose_that_is_right_is_no_sign_of_centimetres(tmp_path: Path) -> None:
    made = make(tmp_path)
    assert CENTIMETRES not in made.read(results(made, tmp_path, in_units(0.1), skip=[1])).notes


def test_depth_that_is_ten_times_too_large_is_not_blamed_on_the_poses(tmp_path: Path) -> None:
    made = make(tmp_path)
    tenfold_depth(made)
    notes = made.read(results(made, tmp_path, lambda T: T)).notes
    assert any(NOWHERE in note for note in notes)
    assert not [note for note in notes if "centimetres" in note]
