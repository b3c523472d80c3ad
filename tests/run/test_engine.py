"""The engine's contract: stepping, rewinding, forking and watching, on stand-in parts."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import MethodSettings
from verefine_viz.methods.registry import METHOD_NAMES, make_method
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run


def method_of(name: str = "rir", **fields: object):  # type: ignore[no-untyped-def]
    settings = msgspec.convert({"name": name, "iterations": 3, **fields}, MethodSettings)
    return make_method(settings, FakeSimulator(), FakeRefiner(), FakeVerifier(), 3)


class Witness:
    """Remembers what it saw."""

    def __init__(self) -> None:
        self.started = 0
        self.finished = 0
        self.seen: list[Iteration] = []

    def on_start(self, state: object) -> None:
        self.started += 1

    def on_iteration(self, state: object, iteration: Iteration) -> None:
        self.seen.append(iteration)

    def on_finish(self, state: object) -> None:
        self.finished += 1


@pytest.mark.parametrize("name", METHOD_NAMES)
def test_stepping_finishing_replaying_and_forking_are_the_same_bit_for_bit(name: str) -> None:
    problem = box_problem(3, 2)
    headless = Run(method_of(name), problem)
    headless.finish()
    stepped = Run(method_of(name), problem)
    while not stepped.at_end:
        stepped.step()
        if stepped.cursor % 4 == 0:  # rewind half of the way and come again
            stepped.seek(stepped.cursor // 2)
            while stepped.cursor < stepped.length:
                stepped.step()
    assert first_difference(headless.iterations, stepped.iterations) is None
    assert first_difference(headless.final_state.best, stepped.final_state.best) is None
    for k in (0, 1, headless.length // 2, headless.length):
        fork = headless.fork(k)
        fork.finish()
        assert first_difference(headless.iterations, fork.iterations) is None


def test_watchers_see_everything_once_and_change_nothing() -> None:
    witness = Witness()
    problem = box_problem(3)
    watched, alone = Run(method_of(), problem, [witness]), Run(method_of(), problem)
    while not watched.at_end:
        watched.step()
        watched.back()
        watched.step()
    alone.finish()
    watched.close()
    assert (witness.started, witness.finished) == (1, 1)
    assert first_difference(tuple(witness.seen), watched.iterations) is None
    assert first_difference(alone.iterations, watched.iterations) is None


def test_watchers_of_a_fork_see_the_shared_past() -> None:
    run = Run(method_of(), box_problem(3))
    run.finish()
    witness = Witness()
    fork = run.fork(4, watchers=[witness])
    assert [it.index for it in witness.seen] == [1, 2, 3, 4]
    fork.finish()
    assert [it.index for it in witness.seen] == list(range(1, 10))


def test_a_fork_with_other_settings_parts_after_k_only() -> None:
    run = Run(method_of(exploration=0.0), box_problem(4))
    run.finish()
    fork = run.fork(3, method=method_of(exploration=1000.0))
    fork.finish()
    assert first_difference(run.iterations[:3], fork.iterations[:3]) is None
    assert first_difference(run.iterations, fork.iterations) is not None
    assert all(np.ptp(it.choice.plays) <= 3 for it in fork.iterations[3:])


def test_an_edited_pose_is_where_the_arm_goes_on_and_a_replay_repeats_it() -> None:
    problem = box_problem(2)
    run = Run(method_of("sir"), problem)
    run.finish()
    T = transform(axis_angle([0, 0, 1], 0.3), [0.01, 0.02, 0.6])
    fork = run.fork(1, edit=(0, 0, T))
    fork.finish()
    assert np.array_equal(fork.iterations[1].stages[0].T_cam_obj, T)
    assert "edited" in [e.kind for e in fork.iterations[1].events]
    again = Run(method_of("sir"), problem, edits=fork.edits)
    again.finish()
    assert first_difference(fork.iterations, again.iterations) is None
    assert run.edits == ()


def test_what_a_run_does_not_have_is_refused() -> None:
    run = Run(method_of("sir"), box_problem(1))
    with pytest.raises(InputError, match="iteration 7 "):
        run.seek(7)
    run.finish()
    with pytest.raises(InputError, match="over"):
        run.step()
    for instance, hypothesis, T in ((9, 0, np.eye(4)), (0, 7, np.eye(4)), (0, 0, np.diag([1.0, 1, -1, 1]))):
        with pytest.raises((InputError, ShapeError)):
            run.fork(0, edit=(instance, hypothesis, T))


def test_records_cannot_be_changed() -> None:
    run = Run(method_of(), box_problem(2))
    iteration = run.step()
    for stage in iteration.stages:
        with pytest.raises(ValueError, match="read-only"):
            stage.T_cam_obj[0, 3] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        iteration.choice.ucb[0] = 1.0
