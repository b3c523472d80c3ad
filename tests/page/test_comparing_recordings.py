"""Recorded runs beside others: what is alike, what goes on, what is refused."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest
from msgspec import structs

from tests.page.recorded import SESSION, Numbered, record
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.settings import MethodSettings, SceneSettings, Session
from verefine_viz.page import protocol as p
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.comparison import comparison
from verefine_viz.page.views.verdict import verdict_message
from verefine_viz.page.workspace import Workspace
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.run_file import RunFile

pytestmark = pytest.mark.usefixtures("processes")


@dataclass(frozen=True)
class Recordings:
    """Files of two methods, and of another frame."""

    rir: Path
    sir: Path
    elsewhere: Path


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Recordings:
    folder = tmp_path_factory.mktemp("recordings")
    return Recordings(
        record(folder / "rir.rrd", SESSION),
        record(folder / "sir.rrd", Session(method=MethodSettings(name="sir", iterations=2))),
        record(folder / "elsewhere.rrd", SESSION, frame="0/1"),
    )


def opened(*verbs: p.AnyVerb) -> Debugger:
    return Debugger(Workspace(SESSION, None, Numbered, frame="0/2")).carry_out(verbs)


def last(d: Debugger) -> int:
    return max(d.space.branches)


def test_a_recording_beside_the_run_it_was_made_of_does_the_same(recordings: Recordings):
    d = opened(p.RunVerb(), p.Compare(recording=str(recordings.rir)))
    assert d.space.work.compare is not None
    answer = comparison(d.space, p.ComparisonWanted(*d.space.work.compare), Blobs())
    assert answer.words == "A and B did the same in all 12 iterations that both have made, bit for bit."
    assert {row.winner for row in answer.rows} == {"even"}


def test_two_recordings_compare_as_the_runs_themselves(recordings: Recordings):
    read = opened(p.Open(recording=str(recordings.rir)))
    read.carry_out([p.Compare(last(read), recording=str(recordings.sir))])
    made = opened(p.RunVerb(), p.Compare(changes={"method.name": "sir"}))
    answers = []
    for d in (read, made):
        assert d.space.work.compare is not None
        answers.append(comparison(d.space, p.ComparisonWanted(*d.space.work.compare), Blobs()))
    assert answers[0].names == ("rir, rir.rrd", "sir, sir.rrd")
    for name in ("pairs", "departures", "words", "rows"):
        assert getattr(answers[0], name) == getattr(answers[1], name), name


def test_a_run_that_ended_early_gets_no_verdict_and_goes_on(tmp_path: Path):
    tools = Numbered(SESSION)
    file = RunFile(tmp_path / "a.vfrun", SESSION)
    run = tools.run(tools.problem("0/2"), (file,))
    for _ in range(5):
        run.step()
    d = opened(p.Open(recording=str(file.path)))
    branch = d.space.work.first
    message = verdict_message(branch)
    assert message.objects == []
    assert message.missing.startswith("the run ended early (it was stopped or cut off); 5 iterations are in it")
    d.carry_out([p.Fork(5, branch.index, run=True)])
    run.finish()
    assert first_difference(d.space.branch(last(d)).run.iterations, run.iterations) is None
    assert verdict_message(d.space.branch(last(d))).objects


def test_recordings_that_do_not_fit_are_refused_in_one_line(recordings: Recordings, tmp_path: Path):
    tower = record(tmp_path / "tower.rrd", structs.replace(SESSION, scene=SceneSettings(demo="tower")))
    (tmp_path / "damaged.rrd").write_bytes(recordings.rir.read_bytes()[:200])
    (tmp_path / "no.rrd").write_text("hello")
    d = opened(p.Open(recording=str(recordings.rir)))
    before = dict(d.space.branches)
    for path, words in (
        (recordings.elsewhere, "elsewhere.rrd shows frame 0/1 of mug, seed 0, A shows frame 0/2 of mug, seed 0; "),
        (tower, "tower.rrd shows frame 0/2 of tower, seed 0, A shows frame 0/2 of mug, seed 0; "),
        (tmp_path / "damaged.rrd", "damaged.rrd"),
        (tmp_path / "no.rrd", "no.rrd is not a rerun recording"),
        (tmp_path / "gone.rrd", "gone.rrd does not exist"),
    ):
        with pytest.raises(VerefineError) as caught:
            d.carry_out([p.Compare(last(d), recording=str(path))])
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)
        assert dict(d.space.branches) == before
