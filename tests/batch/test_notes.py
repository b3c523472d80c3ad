"""What many frames note is told once."""

from __future__ import annotations

import numpy as np

from verefine_viz.batch.totals import Notes
from verefine_viz.core.geometry import rounding_note

LACKS = "mug (#{}) has no hypothesis: no row for object 5"


def counted(*places: tuple[str, ...], most: int = 20) -> dict[str, int]:
    notes = Notes(most)
    for place in places:
        notes.add(place)
    return notes.counted()


def test_an_object_with_one_number_keeps_it() -> None:
    assert counted((LACKS.format(2),), (LACKS.format(2),)) == {LACKS.format(2): 2}


def test_an_object_is_reported_once_whatever_its_number() -> None:
    said = "mug has no hypothesis: no row for object 5"
    assert counted((LACKS.format(0),), (LACKS.format(3),), (LACKS.format(0),)) == {said: 3}
    # Two of them in one frame are one frame.
    assert counted((LACKS.format(0), LACKS.format(1))) == {said: 1}


def test_what_differs_by_its_numbers_alone_is_one_note() -> None:
    rounded = rounding_note("ground truth", [np.diag([1, 1, 1.002])])
    assert rounded[0].endswith(" (1 of 1, RᵀR up to 0.004 from the identity)")
    assert counted(rounded, rounding_note("ground truth", [np.diag([1, 1, 1.01])] * 2)) == {
        "ground truth: rounded rotations; the nearest exact ones are taken": 2
    }
    faults = ("image 1, entry 0: the pose is not rigid", "image 2, entry 1: the pose holds NaN")
    notes = [f"mug (#{k}) has no ground truth: {fault}" for k, fault in enumerate(faults)]
    assert counted(notes[:1]) == {notes[0]: 1}
    assert counted(*zip(notes, strict=True)) == {"mug has no ground truth": 2}


def test_notes_of_other_objects_and_other_reasons_stay_apart() -> None:
    found = counted((LACKS.format(0), "jug (#1) has no hypothesis: no row for object 5", "mug (#0) has no depth"))
    assert len(found) == 3


def test_the_most_frequent_come_first_and_the_first_ones_are_kept() -> None:
    assert list(counted(("a",), ("b",), ("b",)).items()) == [("b", 2), ("a", 1)]
    assert counted(("a", "b", "c"), ("c", "a"), most=2) == {"a": 2, "b": 1}
