"""Which frames' data are in doubt, and why, in a sentence or a few."""

from __future__ import annotations

import pytest

from tests.made_runs import answer
from verefine_viz.batch.totals import Doubts, describe_doubts
from verefine_viz.core.finding import Finding
from verefine_viz.run.record import DATA_FIRST, Answer

LARGE = "objects appear 11% larger: check cam_K"
LARGER = "objects appear 12.5% larger: check cam_K"
FAR = "measured depth is 8% larger: check depth_scale"
SINK = "all 3 objects sink into the support plane: give scene.gravity"
FLOAT = "all 3 objects float above the support plane: give scene.gravity"


@pytest.mark.parametrize(
    ("whys", "said"),
    [
        ([], ""),
        ([FAR], f"{DATA_FIRST} in frame 0/0, {FAR}."),
        ([FAR, LARGE, LARGER], f"{DATA_FIRST} in 3 of 9 frames. In 2, such as 0/1, {LARGE}. In frame 0/0, {FAR}."),
        (
            [FAR, FAR, LARGE, LARGER, SINK, FLOAT],
            f"{DATA_FIRST} in 6 of 9 frames. In 2, such as 0/0, {FAR}. In 2, such as 0/2, {LARGE}. "
            "2 other frames have other reasons.",
        ),
    ],
)
def test_each_reason_is_reported_with_its_frames_the_most_frequent_first(whys: list[str], said: str) -> None:
    doubts = Doubts()
    for k, why in enumerate(whys):
        doubts.add(f"0/{k}", why)
    assert doubts.describe(9) == said


def row(im_id: int, doubt: str) -> Answer:
    return answer(
        scene_id=0, im_id=im_id, findings=(Finding("mask", "The mask leaks."),), doubts=(doubt,) * bool(doubt)
    )


def test_a_frame_counts_once_however_many_of_its_objects_say_so() -> None:
    rows = [row(1, ""), row(1, FAR), row(1, FAR), row(2, "")]
    assert describe_doubts([("rir", rows)]) == f"{DATA_FIRST} in frame 0/1, {FAR}."


def test_of_several_runs_the_one_is_named() -> None:
    one, other = ("rir-0", [row(1, ""), row(2, FAR)]), ("rir-1", [row(1, LARGE), row(2, FAR)])
    assert describe_doubts([one, other]) == (
        f"{DATA_FIRST} in 3 of 4 frames of 2 runs. In 2, such as 0/2 of rir-0, {FAR}. In frame 0/1 of rir-1, {LARGE}."
    )
