"""Two runs side by side: who got better, who got worse."""

from __future__ import annotations

import json

import msgspec
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.received import received
from tests.report.runs import row
from tests.report.sections import NO_ANSWER, WRONG, run
from verefine_viz.core.geometry import transform
from verefine_viz.report.groups import Group
from verefine_viz.report.pair_difference import SAME, apart, difference, wrong_in
from verefine_viz.run.record import Answer


def pair(a: list[Answer], b: list[Answer]) -> tuple[Group, Group, dict[int, int]]:
    keys = {id(one): key for key, one in enumerate((*a, *b))}
    return Group("A", (run("a", *a),)), Group("B", (run("b", *b),)), keys


def test_objects_that_changed_and_what_they_became() -> None:
    a = [row(1, 0, **WRONG), row(1, 1), row(2, 0, **NO_ANSWER), row(2, 1), row(3, 0), row(4, 0)]
    b = [row(1, 0), row(1, 1, add_s_mm=2.1), row(2, 0), row(2, 1, **WRONG), row(3, 0, **NO_ANSWER), row(5, 0)]
    changed = difference(*pair(a, b))
    found = received(changed)
    assert [(o["frame"], o["turned"], o["errors"], o["by"]) for o in found["objects"]] == [
        ("1/2", "right", [None, 2.0], None),
        ("1/1", "right", [40.0, 2.0], -38.0),
        ("1/1", "", [2.0, 2.1], 0.1),
        ("1/2", "wrong", [2.0, 40.0], 38.0),
        ("1/3", "wrong", [2.0, None], None),
    ]
    assert [found[name] for name in ("n", "better", "worse", "now_right", "now_wrong", "both_wrong")] == [
        5, 2, 2, 2, 2, 0
    ]  # fmt: skip
    assert found["only"] == [1, 1]
    assert found["objects"][0]["keys"] == [2, 8]
    assert {f["frame"]: (f["errors"], f["right"]) for f in found["frames"]} == {
        "1/1": ([21.0, 2.05], [1, 2]),
        "1/2": ([2.0, 40.0], [1, 1]),
        "1/3": ([None, None], [1, 0]),
    }
    json.dumps(msgspec.to_builtins(changed), allow_nan=False)


@given(st.lists(st.tuples(st.none() | st.floats(0, 90), st.none() | st.floats(0, 90)), max_size=12))
def test_turned_round_better_is_worse(errors: list[tuple[float | None, float | None]]) -> None:
    def rows(side: int) -> list[Answer]:
        values = [pair[side] for pair in errors]
        return [row(k, **({"add_s_mm": e} if e is not None else NO_ANSWER)) for k, e in enumerate(values)]

    there, back = (difference(*pair(rows(one), rows(1 - one))) for one in (0, 1))
    assert (there.better, there.worse) == (back.worse, back.better)
    assert (there.now_right, there.now_wrong) == (back.now_wrong, back.now_right)
    assert there.both_wrong == back.both_wrong
    assert there.n == len(errors)
    # Listed rounded: 0.5 % may be a little more.
    unchanged = sum(o.by is not None and abs(o.by) < 100 * SAME for o in there.objects)
    both_missing = sum(o.errors == (None, None) for o in there.objects)
    assert there.better + there.worse + max(unchanged, both_missing) <= there.n


def test_without_ground_truth_none_is_wrong_and_how_far_answers_are_apart_is_listed() -> None:
    unknown = {"has_truth": False, "add_s_mm": None}
    shifts = {1: 0.0, 2: 0.03, 3: 0.01}
    a, b, keys = pair(
        [row(k, T_cam_obj=np.eye(4), **unknown) for k in shifts],
        [row(k, T_cam_obj=transform(np.eye(3), [shift, 0, 0]), **unknown) for k, shift in shifts.items()],
    )
    assert wrong_in(a, b) == {}
    assert [(one.frame, one.mm, one.deg) for one in apart(a, b, keys)] == [
        ("1/2", 30.0, 0.0), ("1/3", 10.0, 0.0), ("1/1", 0.0, 0.0)
    ]  # fmt: skip


def test_an_object_is_wrong_in_one_run_or_in_both() -> None:
    a, b, _ = pair(
        [row(1, 0, **WRONG), row(2, 0), row(3, 0, **NO_ANSWER), row(4, 0), row(5, 0, **WRONG)],
        [row(1, 0), row(2, 0, **WRONG), row(3, 0, **WRONG), row(4, 0)],
    )
    words = wrong_in(a, b)
    assert [words.get(id(one), "") for one in a.objects] == [
        "only A wrong",
        "only B wrong",
        "both wrong",
        "",
        "only A wrong",
    ]
    assert [words.get(id(one), "") for one in b.objects] == ["only A wrong", "only B wrong", "both wrong", ""]
