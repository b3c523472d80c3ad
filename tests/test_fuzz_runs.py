"""Damaged run files in every command that reads them: an answer, or one line that is about the run. Never a traceback.

Each case changes one entry of a run file, or which entries there are; lengths and checksums are right all the same.
VEREFINE_FUZZ_RUNS="2000" has it try so many, "2000 500" from number 500 on.
"""

from __future__ import annotations

import os
import random
import re
import shutil
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from tests.page.fake_tools import FakeTools
from tests.page.made_batch import make_batch
from verefine_viz.batch.completeness import check_files, write_tables
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.kept_recordings import KeptRecordings
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.page.answers_to_wants import GoneAnswer
from verefine_viz.page.gallery import read_gallery
from verefine_viz.page.share import shared
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.verify import verify
from verefine_viz.report.report_tools import report_tools
from verefine_viz.report.write_report import write_report
from verefine_viz.run.engine import Run
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_file import MAGIC, framed, read_run_file
from verefine_viz.run.run_header import session_of

pytestmark = pytest.mark.usefixtures("processes")

N, FIRST = (*map(int, os.environ.get("VEREFINE_FUZZ_RUNS", "40").split()), 0)[:2]
LONGEST_S = 30.0
FRAMES = ("0/1", "0/2")
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2, 3, 7, 2.5, 1e-300, 1e308, -1e30, 2**62, -(2**60), 65535, float("nan"), float("inf"), "",
    "x", "a\0b", "\x1b[2J\n", "../..", "0/2", "[[[", b"", b"\0" * 128, [], {}, [[]], [1] * 9, {"a": None},
    "y" * 100_000,
    ["<f8", [4, 4], np.full(16, np.nan).tobytes()], ["<f8", [3], np.ones(3).tobytes()], ["<f8", [4, 4], b""],
    ["<f8", [2**40, 0], b""], ["<i8", [0], b""],
)  # fmt: skip
RAW = re.compile(r"[A-Z]\w+(Error|Exception)\b|Traceback|\$|ndarray|object at 0x|reshape|msgpack|unhashable|subscript")
"""What no line for a person holds."""


# How the entries are spoilt.


def _replaced(content: Any, rng: random.Random) -> Any:
    """The content with a value somewhere replaced, removed or twice."""
    keys = [*content] if isinstance(content, dict) else [*range(len(content))] if isinstance(content, list) else []
    if not keys or rng.random() < 0.1:
        if isinstance(content, int | float) and not isinstance(content, bool) and rng.random() < 0.5:
            return rng.choice((content + 1, -content, content * 1000, float(content) + 0.5))
        return rng.choice(VALUES)
    key, copy = rng.choice(keys), content.copy()
    kind = rng.random()
    if kind < 0.08:
        del copy[key]
    elif kind < 0.14 and isinstance(copy, list):
        copy.insert(key, copy[key])
    else:
        copy[key] = _replaced(content[key], rng)
    return copy


def with_a_value(bodies: list[bytes], rng: random.Random) -> None:
    place = rng.choice((0, len(bodies) - 1, rng.randrange(len(bodies))))
    content = msgspec.msgpack.decode(bodies[place][1:])
    bodies[place] = bodies[place][:1] + msgspec.msgpack.encode(_replaced(content, rng))


def with_other_entries(bodies: list[bytes], rng: random.Random) -> None:
    place, other = rng.randrange(len(bodies)), rng.randrange(len(bodies))
    rng.choice((
        lambda: bodies.pop(place), lambda: bodies.insert(other, bodies[place]),
        lambda: bodies.__setitem__(place, bodies[other]), lambda: bodies.__delitem__(slice(1, -1)),
        lambda: bodies.insert(place, rng.choice((b"", b"I", b"E", b"X", b"I\x80", b"E\xc1", b"I" + b"\x91" * 5000))),
        lambda: bodies.__setitem__(place, bodies[place][: rng.randrange(len(bodies[place]))]),
    ))()  # fmt: skip


SPOILS = (with_a_value, with_a_value, with_a_value, with_a_value, with_other_entries)


def spoil(path: Path, rng: random.Random) -> str:
    content, at, bodies = path.read_bytes(), len(MAGIC), list[bytes]()
    while at < len(content):
        length = int.from_bytes(content[at : at + 4], "little")
        bodies.append(content[at + 8 : at + 8 + length])
        at += 8 + length
    how = rng.choice(SPOILS)
    how(bodies, rng)
    tail = rng.choice((b"", b"", b"", b"", bytes(8), bytes(4000), b"\xff" * 20))
    path.write_bytes(MAGIC + b"".join(map(framed, bodies)) + tail)
    return how.__name__


# What reads them. Each gets the folder of the batch, and the run file that is damaged.


def again(record: RunRecord) -> Run:
    tools = FakeTools(session_of(record.header))
    problem = tools.problem(record.header.frame)
    return tools.run(problem.only([one.instance_id for one in record.header.objects]))


def view(folder: Path, file: Path) -> None:
    debugger = Debugger(Workspace(Session(), None, FakeTools, recording=file), lambda message, window: None)
    run = shared(debugger.carry_out(()), "verefine-viz view", "all")
    gone = [answer.gone for _, answer in run.answers if isinstance(answer, GoneAnswer)]
    assert not any(RAW.search(text) for text in gone), gone


def view_batch(folder: Path, file: Path) -> None:
    gallery = read_gallery(folder)
    for entry in gallery.sorted_by("error"):
        given = {"frame": entry.row.frame, "records": gallery.records(entry.run)}
        space = Workspace(gallery.session(entry.run), None, FakeTools, **given)
        debugger = Debugger(space, lambda message, window: None, gallery=gallery)
        debugger.enter_run(entry.run)
        debugger.show(entry.iteration, entry.row.instance_id, None)
        shared(debugger.carry_out(()), "verefine-viz view", "end")


def draw(folder: Path, file: Path) -> None:
    record = read_run_file(file)
    tools = FakeTools(session_of(record.header))
    problem = tools.problem(record.header.frame)
    recorder = Recorder(file.with_suffix(".rrd"), tools.session, problem, None)
    try:
        Run.from_record(record, problem, [recorder])
    finally:
        recorder.close()


def compare(folder: Path, file: Path) -> None:
    assert not RAW.search(verify(file, again).text)


def resume(folder: Path, file: Path) -> None:
    files = check_files(folder, FRAMES, KeptRecordings("none", len(FRAMES)))
    assert not any(RAW.search(text) for text in files.damaged), files.damaged
    files.totals.as_json(len(FRAMES))
    write_tables(folder, FRAMES, KeptRecordings("none", len(FRAMES)))


def index(folder: Path, file: Path) -> None:
    for path in (folder, folder / "runs"):
        batch = read_batch(path)
        assert not any(RAW.search(note) for note in batch.notes), batch.notes


def report(folder: Path, file: Path) -> None:
    write_report([folder], folder.parent / "report.html", report_tools(), pictures=0)


READERS: tuple[Callable[[Path, Path], None], ...] = (view, view_batch, draw, compare, resume, index, report)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A batch, read by all."""
    folder = tmp_path_factory.mktemp("good") / "run"
    session = Session(method=MethodSettings(name="vf_depth", refiner="identity", iterations=2))
    make_batch(folder, session, FRAMES)
    for read in READERS:
        read(folder, folder / "runs" / "000000_000002.vfrun")
    return folder


def test_a_damaged_run_file_is_an_answer_or_one_line_wherever_it_is_read(good: Path, tmp_path: Path) -> None:
    faults, answers = list[str](), Counter[str]()
    for number in range(FIRST, FIRST + N):
        rng = random.Random(number)
        folder = shutil.copytree(good, tmp_path / str(number))
        file = folder / "runs" / "000000_000002.vfrun"
        how = spoil(file, rng)
        for read in READERS:
            started, what = time.monotonic(), f"case {number}, {how}, {read.__name__}"
            try:
                read(folder, file)
                answers[read.__name__, "read"] += 1
            except VerefineError as error:
                answers[read.__name__, "one line"] += 1
                if RAW.search(str(error)) or len(str(error)) > 1200:
                    faults.append(f"{what}: {error!s:.300}")
            except Exception:
                faults.append(f"{what}:\n{traceback.format_exc(limit=-5)}")
            if time.monotonic() - started > LONGEST_S:
                faults.append(f"{what}: {time.monotonic() - started:.0f} s")
        shutil.rmtree(folder)
        if len(faults) > 20:
            break
    print(f"fuzz: {dict(answers)}", file=sys.stderr)
    assert not faults, "\n".join(faults)
    assert {read for read, _ in answers} == {read.__name__ for read in READERS}
