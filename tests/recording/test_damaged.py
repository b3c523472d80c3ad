"""Damaged recordings and journals: one line each that says what is wrong, whichever command reads them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import rerun as rr

from tests.fakes import box_problem
from tests.recording.runs import new_run, recorded_run, session
from tests.report.runs import row, write_run
from verefine_viz import cli
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.records import Iteration
from verefine_viz.recording import recorder
from verefine_viz.recording.lossless_log import MAGIC, Entry, framed
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import journal_path, part_path

pytestmark = pytest.mark.usefixtures("processes")

SHORT = session(maps=False, iterations=2)


def packed(array: np.ndarray) -> list[Any]:
    """An array as iterations have it."""
    return [array.dtype.str, array.shape, array.tobytes()]


NAN_POSE = packed(np.full((4, 4), np.nan))


def with_properties(path: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[dict[str, Any]], object]) -> None:
    """A recording whose properties were changed."""
    made = recorder.properties

    def changed(*arguments: Any) -> dict[str, Any]:
        values = made(*arguments)
        change(values)
        return values

    with monkeypatch.context() as patched:
        patched.setattr(recorder, "properties", changed)
        recorded_run(path, SHORT)


def with_iteration(path: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[Any], object] | bytes) -> None:
    """A recording whose second iteration was changed: its plain values, or all of its bytes."""

    def changed(iteration: Iteration, errors: Float) -> Entry:
        entry = Entry(iteration, errors)
        if iteration.index == 2:
            values = msgspec.msgpack.decode(entry.packed)
            packed = change if isinstance(change, bytes) else msgspec.msgpack.encode(change(values) or values)
            vars(entry)["packed"] = packed
        return entry

    with monkeypatch.context() as patched:
        patched.setattr(recorder, "Entry", changed)
        recorded_run(path, SHORT)


def changed_layout(change: Callable[[dict[str, Any]], object]) -> Callable[[dict[str, Any]], None]:
    def changed(properties: dict[str, Any]) -> None:
        layout = json.loads(properties["layout"])
        change(layout)
        properties["layout"] = json.dumps(layout)

    return changed


def refused(path: Path) -> str:
    """The one line with which the recording is refused."""
    with pytest.raises(VerefineError) as caught:
        read_recording(path)
    text = str(caught.value)
    assert path.name in text
    assert "\n" not in text
    return text


PROPERTIES: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda p: p.pop("session"), "its session cannot be read by this version: Field required"),
    (lambda p: p.pop("settings"), "its settings cannot be read"),
    (lambda p: p.pop("layout"), "its layout cannot be read"),
    (lambda p: p.pop("schema"), "a rerun recording of another program"),
    (lambda p: p.update(schema="three"), "its schema is 'three'"),
    (lambda p: p.update(schema=-1), "its schema is '-1'"),
    (lambda p: p.update(frame="../.."), "its frame cannot be read"),
    (lambda p: p.update(settings="[]"), "its settings cannot be read"),
    (lambda p: p.update(settings="[" * 100_000), "its settings cannot be read"),
    (lambda p: p.update(versions="[]"), "its versions cannot be read"),
    (lambda p: p.update(versions='{"numpy": {}}'), "its versions cannot be read"),
    (lambda p: p.update(layout="{}"), "its layout cannot be read"),
    (lambda p: p.update(layout="null"), "its layout cannot be read"),
    (lambda p: p.update(layout="[" * 5000), "its layout cannot be read"),
    (changed_layout(lambda d: d.update(branches=[])), "iteration 1 is about hypothesis"),
    (changed_layout(lambda d: d.update(branches=5)), "(branches)"),
    (changed_layout(lambda d: d.update(center_world=[float("nan")] * 3)), "its layout cannot be read"),
    (changed_layout(lambda d: d.update(eye_world=[0.0])), "its layout cannot be read"),
    (changed_layout(lambda d: d.update(width_m=None)), "(width_m)"),
    (changed_layout(lambda d: d["branches"].append(d["branches"][0])), "an object is in it twice"),
    (changed_layout(lambda d: d["branches"][0].update(name="../x")), "no name of an object's entities"),
    (changed_layout(lambda d: d["branches"][0].update(name=[])), "(branches.0.name)"),
    (changed_layout(lambda d: d["branches"][0].update(instance_id=99)), "of instance 0, which has 0"),
    (changed_layout(lambda d: d["branches"][0].update(sources=[1])), "(branches.0.sources.0)"),
    (changed_layout(lambda d: d["branches"][0].update(initial=[[0.5]])), "are not 10 numbers for each of its 3"),
    (changed_layout(lambda d: d["branches"][0].update(has_truth=[])), "(branches.0.has_truth)"),
]


def test_damaged_properties(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for k, (change, expected) in enumerate(PROPERTIES):
        with_properties(tmp_path / f"{k}.rrd", monkeypatch, change)
        assert expected in refused(tmp_path / f"{k}.rrd"), expected


ITERATIONS: list[tuple[Callable[[Any], object] | bytes, str]] = [
    (b"\xc1", "an iteration cannot be read"),
    (b"\x91" * 5000, "an iteration cannot be read"),
    (b"\xdd\xff\xff\xff\xff", "an iteration cannot be read"),
    (msgspec.msgpack.encode(5), "an iteration cannot be read"),
    (lambda v: v["iteration"].pop("stages"), "an iteration cannot be read"),
    (lambda v: v["iteration"].update(arm=99), "iteration 2 is about hypothesis 100 of instance 0, which has 3"),
    (lambda v: v["iteration"].update(arm=-1), "iteration 2 is about hypothesis 0"),
    (lambda v: v["iteration"].update(instance_id=7), "hypothesis 1 of instance 7, which has 0"),
    (lambda v: v["iteration"].update(stages=[]), "iteration 2 accepted its"),
    (lambda v: v["iteration"].update(accepted="edited"), "iteration 2 accepted its edited pose, and has none"),
    (lambda v: v["iteration"].update(accepted="\x1b[31m\nx"), "an iteration cannot be read"),
    (lambda v: v["iteration"]["stages"][0].update(T_cam_obj=NAN_POSE), "holds NaN"),
    (lambda v: v["iteration"]["stages"][0].update(T_cam_obj=packed(np.ones(3))), "has shape (3,), expected 4×4"),
    (lambda v: v["iteration"]["best"].update(T_cam_obj="x"), "$.iteration.best.T_cam_obj"),
    (lambda v: v["iteration"]["choice"].update(mean=packed(np.zeros(0))), "another number of hypotheses than 3"),
    (lambda v: v["iteration"]["path"].update(Ts_cam_obj=packed(np.zeros((0, 3)))), "an iteration cannot be read"),
    (lambda v: v["iteration"]["path"].update(contacts=5), "$.iteration.path"),
    (lambda v: v["iteration"].update(placed=[{"instance_id": 9, "T_cam_obj": packed(np.eye(4))}]), "places instance 9"),
    (lambda v: v.update(errors=packed(np.zeros(1))), "errors has shape (1,), expected 3"),
    (lambda v: v.update(errors=["a", "b", "c"]), "$.errors"),
]


def test_damaged_iterations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for k, (change, expected) in enumerate(ITERATIONS):
        with_iteration(tmp_path / f"{k}.rrd", monkeypatch, change)
        assert expected in refused(tmp_path / f"{k}.rrd"), expected


def journalled(path: Path) -> bytes:
    """The journal of a run that was killed after three iterations, before anything was drawn."""
    run = new_run(SHORT, problem := box_problem(), (Recorder(path, SHORT, problem),))
    for _ in range(3):
        run.step()
    content = journal_path(path).read_bytes()
    run.close()
    path.unlink()
    return content


def of(about: object, *entries: bytes) -> bytes:
    head = about if isinstance(about, bytes) else msgspec.msgpack.encode(about)
    return MAGIC + b"".join(map(framed, (head, *entries)))


ABOUT = {"schema": str(recorder.SCHEMA), "title": "boxes"}
JOURNALS = [
    (of([]), "it does not begin with what the run is about"),
    (of(5), "it does not begin with what the run is about"),
    (of(b"\xc1"), "is damaged"),
    (of({}), "another program"),
    (of(ABOUT), "its frame cannot be read"),
    (of({"schema": [1]}), "its schema is '[1]'"),
    (of({**ABOUT, "title": 7}), "its title cannot be read"),
    (of({"schema": 2}), "by an earlier version"),
    (of(ABOUT, b"x"), "not an iteration"),
    (of(ABOUT, msgspec.msgpack.encode({})), "is damaged"),
    (of(ABOUT, b"\x91" * 5000), "is damaged"),
    (b"VRFJ5\n", "was written by another version"),
    (b"", "another program"),
    (MAGIC, "another program"),
    (bytes(range(256)) * 4, "another program"),
]


@pytest.mark.parametrize("part", [None, b"", b"RRF2"])
def test_damaged_journals(tmp_path: Path, part: bytes | None) -> None:
    path = tmp_path / "run.rrd"
    if part is not None:
        part_path(path).write_bytes(part)
    for content, expected in JOURNALS:
        journal_path(path).write_bytes(content)
        assert expected in refused(path)


def test_a_journal_is_read_up_to_where_it_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    content = bytearray(journalled(path))
    content[-10] ^= 1
    journal_path(path).write_bytes(content)
    assert len(read_recording(path).entries) == 2


def test_flipped_bits_and_noise_anywhere_are_read_or_refused(tmp_path: Path) -> None:
    """Bytes that make no sense must not take the process with them."""
    path, rng = tmp_path / "run.rrd", np.random.default_rng(0)
    recorded_run(path, SHORT)
    whole = path.read_bytes()
    outcomes, messages = set[int](), list[str]()
    for k in range(60):
        content = bytearray(whole)
        at = int(rng.integers(4, len(content)))
        content[at : at + 40 * (k % 2) + 1] = rng.bytes(40 * (k % 2) + 1)
        path.write_bytes(content)
        try:
            outcomes.add(len(read_recording(path).entries))
        except VerefineError as error:
            messages.append(str(error))
    assert 12 in outcomes
    assert messages
    assert not any("\n" in message for message in messages)


def foreign(path: Path) -> None:
    stream = rr.RecordingStream("another", send_properties=False)
    stream.save(path)
    stream.log("points", rr.Points3D([[0, 0, 0]]))
    stream.flush()
    stream.disconnect()


def loop(path: Path) -> None:
    path.symlink_to(path)


def cut(path: Path) -> None:
    recorded_run(path, SHORT)
    path.write_bytes(path.read_bytes()[:2000])


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


FILES: list[tuple[Callable[[Path], object], str]] = [
    (lambda path: None, "does not exist"),
    (os.mkdir, "is a folder"),
    (os.mkfifo, "is a pipe"),
    (device, "is a device"),
    (loop, "cannot be read: Too many levels of symbolic links"),
    (foreign, "another program"),
    (cut, "ended early: it holds nothing of a run"),
    (lambda path: path.write_bytes(b""), "is empty"),
    (lambda path: path.write_bytes(b"hello"), "is not a rerun recording"),
    (lambda path: path.write_bytes(b"RRF2" + bytes(60)), "run.rrd"),
    (lambda path: os.mkfifo(journal_path(path)), "does not exist"),
    (lambda path: os.mkfifo(part_path(path)), "does not exist"),
]
COMMANDS = [["view"], ["replay"], ["replay", "--verify"]]


def test_no_recording_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for k, (make, expected) in enumerate(FILES):
        path = tmp_path / str(k) / "run.rrd"
        path.parent.mkdir()
        make(path)
        assert_one_line(cli.main(["view", str(path)]), capsys, expected)


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_damaged_recording_or_an_impossible_name_is_one_line_of_every_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    with_properties(tmp_path / "run.rrd", monkeypatch, lambda p: p.pop("session"))
    assert_one_line(cli.main([*command, str(tmp_path / "run.rrd")]), capsys, "run its session again")
    for name in ("a\0b.rrd", "x" * 300 + ".rrd"):
        assert_one_line(cli.main([*command, str(tmp_path / name)]), capsys, "")


def assert_one_line(code: int, capsys: pytest.CaptureFixture[str], expected: str) -> None:
    output = capsys.readouterr()
    assert code == 2
    assert output.out == ""
    assert output.err.startswith("verefine-viz: ")
    assert output.err.count("\n") == 1
    assert expected in output.err


def test_a_report_of_a_batch_with_a_damaged_recording_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = write_run(tmp_path / "run", [row(1, add_s_mm=50.0)])
    (run / "recordings").mkdir(exist_ok=True)
    with_properties(run / "recordings" / "000001_000001.rrd", monkeypatch, lambda p: p.pop("session"))
    assert cli.main(["report", str(run), "--out", str(tmp_path / "report.html")]) == 0
    assert "its session cannot be read by this version" in (tmp_path / "report.html").read_text(encoding="utf-8")
