"""What stands out in a sequence: all that was planted is found, and nothing else."""

from __future__ import annotations

import numpy as np

from tests.planted_sequence import AROUND, HALF_TURN, Planted, planted
from verefine_viz.evaluation.pose_motion import JUMP_MM, NO_SYMMETRY, PosedFrame, marks, motions

N = 2000


def found(one: Planted, turns: np.ndarray = HALF_TURN, symmetries: np.ndarray = NO_SYMMETRY) -> list[tuple[int, str]]:
    poses = [PosedFrame(f"0/{i}", T) for i, T in enumerate(one.poses)]
    return [(mark.place, mark.kind) for mark in marks([m.kind for m in motions(poses, np.zeros(3), turns, symmetries)])]


def test_all_that_was_planted_is_found_and_nothing_else() -> None:
    n_marks = 0
    for seed in range(6):
        one = planted(N, 25, seed, mm=3.0, deg=4.0)
        assert found(one) == [*one.marks], seed
        n_marks += len(one.marks)
    assert n_marks > 150


def test_an_object_that_looks_alike_from_all_sides_turns_without_a_mark() -> None:
    for seed in range(3):
        one = planted(N, 25, seed, is_bowl=True)
        assert found(one, np.zeros((0, 4, 4)), AROUND) == [*one.marks], seed


def test_a_calm_sequence_has_no_mark() -> None:
    assert found(planted(N, 0, 0, mm=4.0, deg=5.0)) == []


def test_an_object_that_went_on_while_it_was_lost_did_not_jump() -> None:
    one = planted(N, 0, 0)
    poses = tuple(None if 500 <= i < 530 else T for i, T in enumerate(one.poses))
    apart_mm = 1e3 * np.linalg.norm(one.poses[530][:3, 3] - one.poses[499][:3, 3])  # type: ignore[index]
    assert apart_mm > JUMP_MM
    assert found(Planted(poses, ())) == [(500, "lost"), (530, "recovered")]


def test_frames_that_wait_are_not_lost() -> None:
    assert [(m.place, m.kind) for m in marks(["no pose", "moved", "not solved", "moved", "not solved", "no pose"])] == [
        (5, "lost")
    ]
