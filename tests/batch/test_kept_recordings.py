from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tests.batch.at_once import AtOnce, Loop, solved
from verefine_viz.batch.kept_recordings import SAMPLE, Keep, KeptRecordings
from verefine_viz.batch.runs import file_stem
from verefine_viz.core.settings import Session
from verefine_viz.run.record import Answer, RunEnd, RunRecord

RIGHT = RunEnd(answers=(Answer(frame="0/0", status="ok"),))
MISSED = RunEnd(answers=(Answer(frame="0/0", status="no_answer"),))
FAILED = RunEnd(answers=(Answer(frame="0/0", status="failed"),))


def test_what_is_kept_follows_from_the_setting_and_the_answers() -> None:
    wanted: dict[Keep, tuple[bool, bool]] = {
        "sample": (True, True), "all": (True, True), "failures": (False, True), "none": (False, False)
    }  # fmt: skip
    for keep, (right, missed) in wanted.items():
        kept = KeptRecordings(keep, SAMPLE)
        assert (kept.holds("0/0", RIGHT), kept.holds("0/0", MISSED)) == (right, missed), keep
        assert not kept.holds("0/0", FAILED)
        assert kept.always("0/0") == (keep in ("sample", "all"))


def test_of_a_large_batch_about_two_hundred_and_every_failure() -> None:
    kept = KeptRecordings("sample", 20_000)
    frames = [f"{scene}/{image}" for scene in range(20) for image in range(1000)]
    assert 150 < sum(kept.holds(frame, RIGHT) for frame in frames) < 250
    assert all(kept.holds(frame, MISSED) for frame in frames)
    other = KeptRecordings("sample", 20_000, seed=1)
    assert [f for f in frames if other.always(f)] != [f for f in frames if kept.always(f)]


@given(st.integers(0, 10**6), st.integers(1, 10**5), st.integers(1, 10**5))
def test_what_is_kept_of_a_batch_that_grew_was_kept_before(image: int, n: int, more: int) -> None:
    if KeptRecordings("sample", n + more).always(f"0/{image}"):
        assert KeptRecordings("sample", n).always(f"0/{image}")


def test_a_sampled_batch_misses_nothing_and_says_once_what_it_saves(loop: Loop) -> None:
    frames = loop.frames(2 * SAMPLE)
    kept = KeptRecordings.of(Session(), len(frames))

    def recorded(frame: str) -> RunRecord:
        if kept.always(frame):
            (loop.out / "recordings" / f"{file_stem(frame)}.rrd").write_bytes(bytes(1_000_000))
        return solved(frame)

    (note,) = loop.run(workers=AtOnce(recorded, leaves_recordings=False)).notes
    n_kept = sum(map(kept.always, frames))
    assert f"{n_kept} frames" in note
    assert f"{len(frames) - n_kept} MB" in note
    assert loop.run().notes == ()
