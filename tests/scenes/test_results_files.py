"""Estimated poses in arrays and YAML: the same rows as in BOP's CSV."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from tests.scenes.test_trace import pose
from verefine_viz.core.errors import InputError
from verefine_viz.scenes.results_csv import ResultRow, write_results
from verefine_viz.scenes.results_files import read_estimates

ROWS = [ResultRow(2, k, 5 + k, 0.25 * k, pose(10.0 * k, 0.01)) for k in range(3)]
POSES = np.stack([row.T_cam_obj for row in ROWS])
IDS = {name: np.array([getattr(row, name) for row in ROWS]) for name in ("scene_id", "im_id", "obj_id")}
SCORES = np.array([row.score for row in ROWS])


def same(path: Path, with_scores: bool = True) -> bool:
    rows = read_estimates(path).rows
    ids = [(row.scene_id, row.im_id, row.obj_id) for row in rows]
    scores = [row.score for row in rows] == (SCORES.tolist() if with_scores else [1.0] * len(ROWS))
    is_close = all(np.allclose(a.T_cam_obj, b.T_cam_obj, atol=1e-6) for a, b in zip(rows, ROWS, strict=True))
    return scores and is_close and ids == [(row.scene_id, row.im_id, row.obj_id) for row in ROWS]


def test_arrays_and_csv_hold_the_same_rows(tmp_path: Path) -> None:
    write_results(tmp_path / "a.csv", ROWS)
    assert same(tmp_path / "a.csv")
    np.savez(tmp_path / "b.npz", **IDS, score=SCORES, R=POSES[:, :3, :3], t=POSES[:, :3, 3] * 1000)
    assert same(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", **IDS, scores=SCORES, poses=POSES[:, :3])
    assert same(tmp_path / "c.npz")
    in_mm = POSES.copy()
    in_mm[:, :3, 3] *= 1000
    others = {"scene_id": IDS["scene_id"], "image_id": IDS["im_id"], "object_id": IDS["obj_id"]}
    np.savez(tmp_path / "d.npz", **others, poses=in_mm)
    assert same(tmp_path / "d.npz", with_scores=False)


def test_yaml_of_foundation_pose_is_read(tmp_path: Path) -> None:
    lines = ["2:"]
    for row in ROWS:
        numbers = "\n".join(f"      - {line.tolist()}" for line in row.T_cam_obj)
        lines += [f"  '{row.im_id:06d}':", f"    {row.obj_id}:", numbers]
    (tmp_path / "linemod_res.yml").write_text("\n".join(lines))
    assert same(tmp_path / "linemod_res.yml", with_scores=False)


def test_what_is_none_is_one_line(tmp_path: Path) -> None:
    for name, content, message in (
        ("a.pkl", pickle.dumps({"pose": 1}), "is pickled, and reading it could run code"),
        ("a.yml", b"2: {3: {1: [1, 2]}}", "2, 3, 1: Expected 16 numbers"),
        ("a.yml", b"2: &a {1: {1: [1]}}\n3: *a\n", "aliases"),
        ("a.yml", b"[", "not YAML from line 2"),
        ("a.npz", b"PK", "a.npz"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=message) as error:
            read_estimates(tmp_path / name)
        assert "\n" not in str(error.value)


def test_arrays_that_do_not_fit_are_named(tmp_path: Path) -> None:
    for arrays, message in (
        ({**IDS, "poses": POSES[:2]}, "2, 3 entries"),
        ({**IDS, "poses": POSES * np.nan}, "finite"),
        ({**IDS}, "neither 'poses' nor 'R' and 't'"),
        ({"poses": POSES}, "no array 'scene_id', only poses"),
    ):
        np.savez(tmp_path / "a.npz", **arrays)
        with pytest.raises(InputError, match=message):
            read_estimates(tmp_path / "a.npz")
