"""Average recall frame by frame."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.batch.frames import SCENE_ID, make_frames
from tests.report.runs import row, write_run
from verefine_viz.report.bop_recalls import frame_recalls
from verefine_viz.report.groups import load_groups
from verefine_viz.report.object_results import axes_of


def test_a_frame_in_which_nothing_is_seen_asks_for_nothing(tmp_path: Path) -> None:
    made = make_frames(tmp_path / "data", 3)
    made.edit("scene_gt_info.json", lambda info: info.update({"1": [{"visib_fract": 0.05}] * 3}))
    session = {"scene": {"source": "bop", "dataset": str(made.root)}}
    rows = [row(im_id, 1, scene_id=SCENE_ID, obj_id=5) for im_id in range(3)]
    T_gt = made.problem.instances[1].T_cam_obj_gt
    folders = [
        write_run(tmp_path / name, mine, {**session, "method": {"name": name}}, T_gt)
        for name, mine in (("rir", rows), ("sir", rows[1:]))
    ]
    groups = load_groups(folders).groups
    found = frame_recalls([run for group in groups for run in group.runs])
    assert found.note == (
        "BOP scores over all instances that are at least 10 % visible in these frames. "
        "There is no models_eval; errors are measured on models, which differs a little."
    )
    asked = {(folder.name, frame): n for (folder, frame), (n, _) in found.by_frame.items()}
    assert asked == {("rir", "7/0"): 3, ("rir", "7/1"): 0, ("rir", "7/2"): 3, ("sir", "7/1"): 0, ("sir", "7/2"): 3}
    cells = [found.cells(group.runs, axes_of(groups)) for group in groups]
    # One of three instances is found in the frames that ask for any.
    assert [cell.mean if cell else None for cell in cells] == pytest.approx([1 / 3, 1 / 3])
    assert [cell.n.sum() if cell else 0 for cell in cells] == [6, 3]
