"""Run files: every bit comes back, whatever of a file is there is read, and nothing else passes for a run."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.changing import replace
from tests.fakes import box_problem
from tests.full_disk import file_limit
from tests.made_runs import answer, because, finished, write_first_format
from tests.methods.test_physim_mcts import method_of
from tests.recording.runs import ending, new_run, run_file, session
from verefine_viz.core.errors import InputError
from verefine_viz.core.finding import Finding
from verefine_viz.methods.registry import METHOD_NAMES
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.answers import table_lines
from verefine_viz.run.engine import Run
from verefine_viz.run.record import FORMAT, Answer, RunEnd, RunHeader
from verefine_viz.run.run_file import MAGIC, RunFile, as_read, framed, read_run_file
from verefine_viz.run.run_header import session_of

SHORT = session(maps=False, iterations=2)


@pytest.mark.parametrize("name", [*METHOD_NAMES, "physim_mcts"])
def test_every_bit_of_every_iteration_comes_back(tmp_path: Path, name: str) -> None:
    problem, file = box_problem(3, 2), RunFile(tmp_path / "a.vfrun", session())
    if name == "physim_mcts":
        run = Run(method_of(problem), problem, (file,))
    else:
        run = new_run(session(name, iterations=3), problem, (file,))
    run.finish()
    file.finish(ending(run))
    record = read_run_file(file.path)
    assert record.is_complete
    assert record.missing == ""
    assert len(record.iterations) == run.length
    for back, iteration in zip(record.iterations, run.iterations, strict=True):
        assert first_difference(replace(back, path=None), replace(iteration, path=None)) is None
        assert first_difference(back, as_read(iteration)) is None
        assert [s.ms for s in back.stages] == [s.ms for s in iteration.stages]


@pytest.mark.parametrize("name", ["sir", "vf_depth"])
def test_the_simulated_path_comes_back_in_single_precision(tmp_path: Path, name: str) -> None:
    run = run_file(tmp_path / "a.vfrun", session(name, maps=False))
    for back, iteration in zip(read_run_file(tmp_path / "a.vfrun").iterations, run.iterations, strict=True):
        ours, theirs = back.path, iteration.path
        assert ours is not None
        assert theirs is not None
        np.testing.assert_array_equal(ours.Ts_cam_obj, theirs.Ts_cam_obj.astype(np.float32))
        assert len(ours.contacts) == len(theirs.contacts)
        assert first_difference(ours.contacts[-1], theirs.contacts[-1]) is None


def test_the_header_lets_it_run_again(tmp_path: Path) -> None:
    s = session("sir")
    run = run_file(tmp_path / "a.vfrun", s)
    header = read_run_file(tmp_path / "a.vfrun", with_iterations=False).header
    assert session_of(header) == s
    assert (header.title, header.frame) == ("boxes", "0/1")
    assert {"python", "numpy", "numba", "pybullet"} <= set(header.versions)
    for one, target, scores in zip(header.objects, run.problem.targets, run.state_at(0).initial, strict=True):
        assert (one.instance_id, one.obj_id) == (target.instance.instance_id, target.instance.obj_id)
        assert first_difference(one.T_cam_obj_gt, target.instance.T_cam_obj_gt) is None
        for ours, theirs in zip(one.hypotheses, target.instance.hypotheses, strict=True):
            assert first_difference(ours, theirs) is None
        assert first_difference(one.initial, tuple(scores[j] for j in range(len(scores)))) is None


floats = st.none() | st.floats(-1e300, 1e300)
lengths_mm = st.none() | st.floats(0, 1e300)


@given(
    score=floats, mm=lengths_mm, name=st.text(), status=st.sampled_from(["ok", "no_answer", "left_out", "failed"]),
    n=st.integers(0, 2**31 - 1), T=st.none() | st.just(np.eye(4)),
)  # fmt: skip
@settings(max_examples=30, deadline=None)
def test_answers_come_back(tmp_path_factory: pytest.TempPathFactory, score, mm, name, status, n, T) -> None:
    numbers = {"error": np.float64(0.3), "hypotheses": n, "error_repaired": np.inf}
    findings = (Finding("budget", name, numbers, True, "more", 0, {"method.iterations": n}, name, name),)
    known = {"frame": "0/1", "name": name, "status": status, "score": score, "add_s_mm": mm, "n_hypotheses": n}
    end = RunEnd(
        answers=(Answer(**known, T_cam_obj=T, findings=findings, doubts=(name,)),),
        stages_ms={"read": 1.5},
        doubts=(name,),
        seconds=2.0,
    )
    file = RunFile(tmp_path_factory.mktemp("answers") / "a.vfrun", SHORT)
    file.begin(RunHeader(FORMAT, "", "0/1", "", {}, ()))
    file.finish(end)
    assert first_difference(read_run_file(file.path).end, end) is None


def test_a_file_of_the_first_format_gives_its_causes_and_doubts(tmp_path: Path) -> None:
    wrong = {"has_truth": True, "add_s_mm": 40.0, "diameter_mm": 100.0}
    answers = (
        answer(instance_id=0, findings=because("mask", "The mask leaks."), doubts=("cam_K", "the depth"), **wrong),
        answer(instance_id=1, findings=because("impossible", "It cannot lie there.")),
        answer(instance_id=2, doubts=("objects appear 11% larger: check cam_K",)),
        answer(instance_id=3, findings=because("", "no diagnosis: an error of the program"), **wrong),
        answer(instance_id=4),
    )
    record = finished("1/0", answers, doubts=("cam_K",))
    write_first_format(tmp_path / "old.vfrun", record)
    old = read_run_file(tmp_path / "old.vfrun")
    assert old.header.format == 1
    assert first_difference(old.end, record.end) is None
    assert table_lines(old) == table_lines(record)
    assert [one.cause for one in old.end.answers] == ["mask", "impossible", "", "", ""]
    assert old.end.answers[0].evidence == (
        "The mask leaks. Look at the data first: cam_K. Look at the data first: the depth."
    )


def test_an_iteration_is_in_the_file_when_the_next_one_begins(tmp_path: Path) -> None:
    path = tmp_path / "a.vfrun"
    run = new_run(SHORT, box_problem(3, 2), (RunFile(path, SHORT),))
    for k in range(5):
        record = read_run_file(path)
        assert (len(record.iterations), record.end) == (k, None)
        run.step()


def test_a_file_cut_anywhere_gives_the_iterations_before_and_says_so(tmp_path: Path) -> None:
    run = run_file(tmp_path / "a.vfrun", SHORT)
    content, whole = (tmp_path / "a.vfrun").read_bytes(), read_run_file(tmp_path / "a.vfrun")
    n_read, lengths = list[int](), list[int]()
    for cut in range(len(content) - 1, 0, -97):
        (tmp_path / "cut.vfrun").write_bytes(content[:cut])
        try:
            record = read_run_file(tmp_path / "cut.vfrun")
        except InputError:  # Not even the header is whole.
            lengths.append(cut)
            continue
        n = len(record.iterations)
        n_read.append(n)
        assert first_difference(record.iterations, whole.iterations[:n]) is None
        assert (record.is_complete, record.damaged, record.end) == (False, False, None)
        assert record.missing.startswith("the run ended early (it was stopped or cut off); ")
    assert n_read == sorted(n_read, reverse=True)
    assert max(lengths) < len(content) / 4
    assert {*n_read} == {*range(run.length + 1)}


def test_changed_bytes_in_the_middle_end_the_run_before_them(tmp_path: Path) -> None:
    run = run_file(tmp_path / "a.vfrun", SHORT)
    content = (tmp_path / "a.vfrun").read_bytes()
    for at in range(len(content) // 2, len(content), 331):
        changed = bytearray(content)
        changed[at] ^= 1
        (tmp_path / "b.vfrun").write_bytes(changed)
        record = read_run_file(tmp_path / "b.vfrun")
        assert len(record.iterations) <= run.length
        assert (record.is_complete, record.end) == (False, None)
        assert "the run ended early" in record.missing
    changed = bytearray(content)
    changed[len(content) // 2] ^= 1
    (tmp_path / "b.vfrun").write_bytes(changed)
    assert read_run_file(tmp_path / "b.vfrun").damaged
    assert "bytes in the middle are damaged" in read_run_file(tmp_path / "b.vfrun").missing


def packed(array: np.ndarray) -> list[Any]:
    """An array as it is written."""
    return [array.dtype.str, array.shape, array.tobytes()]


def refused(path: Path, with_iterations: bool = True) -> str:
    with pytest.raises(InputError) as caught:
        read_run_file(path, with_iterations)
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)
    return str(caught.value)


def bodies_of(path: Path) -> list[bytes]:
    content, at, bodies = path.read_bytes(), len(MAGIC), []
    while at < len(content):
        length = int.from_bytes(content[at : at + 4], "little")
        bodies.append(content[at + 8 : at + 8 + length])
        at += 8 + length
    return bodies


NAN_POSE = packed(np.full((4, 4), np.nan))
ITERATIONS: list[tuple[Callable[[Any], object], str]] = [
    (lambda v: v.pop("stages"), "is damaged"),
    (lambda v: v.update(index=3), "iteration 2 is missing"),
    (lambda v: v.update(arm=99), "iteration 2 is about hypothesis 100 of instance 0, which has 3"),
    (lambda v: v.update(accepted="edited"), "iteration 2 accepted its edited pose, and has none"),
    (lambda v: v["stages"][0].update(T_cam_obj=NAN_POSE), "holds NaN"),
    (lambda v: v["stages"][0].update(T_cam_obj=packed(np.ones(3))), "has shape (3,), expected 4×4"),
    (lambda v: v["choice"].update(mean=packed(np.zeros(0))), "another number of hypotheses than 3"),
    (lambda v: v["choice"].update(mean=packed(np.full(3, np.nan))), "mean holds NaN"),
    (lambda v: v["choice"].update(arm=3), "another number of hypotheses than 3"),
    (lambda v: v["best"].update(arm=3), "is of a hypothesis or iteration that is not there"),
    (lambda v: v["best"].update(iteration=3), "is of a hypothesis or iteration that is not there"),
    (lambda v: v.update(obj_id=9), "is about object 9, and instance 0 is another"),
    (lambda v: v.update(score_ms=np.nan), "iteration 2: Expected `float`"),
    (lambda v: v["path"].update(Ts_cam_obj=packed(np.eye(4))), "a simulation has no pose"),
    (lambda v: v["path"].update(contacts=9 * v["path"]["contacts"]), "has more contacts than steps"),
    (lambda v: v["stages"][0].update(T_cam_obj=["<f8", [2**40, 0], b""]), "do not fill its shape"),
    (lambda v: v["stages"][0].update(T_cam_obj=["<f8", [4, 4], "text"]), "do not fill its shape"),
    (lambda v: v["stages"][0].update(T_cam_obj=7), "no array"),
    (lambda v: v.update(placed=[{"instance_id": 9, "T_cam_obj": packed(np.eye(4))}]), "places instance 9"),
]
HEADERS: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda h: h.update(format=99), "was written by a later version (format 99, this one reads 2); update"),
    (lambda h: h.update(frame="../.."), "frame '../..' is not"),
    (lambda h: h.update(session="[[[x"), "its session is no TOML"),
    (lambda h: h.update(frame="00/1"), "'00/1' is no frame"),
    (lambda h: h.update(frame=f"0/{'9' * 5000}"), 'is not "scene/image"'),
    (lambda h: h.update(T_table_cam=packed(np.ones(3))), "table has shape (3,)"),
    (lambda h: h["objects"][0].update(T_cam_obj_gt=NAN_POSE), "ground truth of box holds NaN"),
    (
        lambda h: h["objects"][0].update(diameter_m=0.0),
        "its header: Expected `float` > 0.0 (at .objects[0].diameter_m)",
    ),
    (lambda h: h["objects"].append(h["objects"][0]), "an object is in it twice"),
    (lambda h: h["objects"][0].update(instance_id=99), "of instance 0, which has 0"),
    (lambda h: h["objects"][0]["hypotheses"].pop(), "has 2 hypotheses and 3 scores"),
]


def test_damaged_iterations_and_headers_are_one_line(tmp_path: Path) -> None:
    """Where lengths and checksums are right all the same."""
    run_file(tmp_path / "a.vfrun", SHORT)
    bodies = bodies_of(tmp_path / "a.vfrun")
    path = tmp_path / "b.vfrun"
    for place, changes in ((2, ITERATIONS), (0, HEADERS)):
        for change, expected in changes:
            values = msgspec.msgpack.decode(bodies[place][1:])
            change(values)
            body = bodies[place][:1] + msgspec.msgpack.encode(values)
            path.write_bytes(MAGIC + b"".join(map(framed, [*bodies[:place], body, *bodies[place + 1 :]])))
            assert expected in refused(path), expected


def test_what_is_no_run_file_is_one_line(tmp_path: Path) -> None:
    assert "does not exist" in refused(tmp_path / "none.vfrun")
    os.mkfifo(tmp_path / "pipe.vfrun")
    assert "is a pipe" in refused(tmp_path / "pipe.vfrun")
    for content, said in (
        (b"", "is empty"),
        (b"hello", "is no run file"),
        (MAGIC + bytes(60), "holds nothing of a run"),
    ):
        (tmp_path / "a.vfrun").write_bytes(content)
        assert said in refused(tmp_path / "a.vfrun")


def test_entries_that_are_missing_doubled_or_of_no_kind_are_damage(tmp_path: Path) -> None:
    """Where each entry is whole; with and without the iterations, as a batch that goes on reads it."""
    run = run_file(tmp_path / "a.vfrun", SHORT)
    header, *iterations, end = bodies_of(tmp_path / "a.vfrun")
    for bodies, expected in (
        ([header, end], f"its answers come from {run.length} iterations, and none are in it"),
        ([header, *iterations[:-1], end], f"come from {run.length} iterations, and {run.length - 1} are in it"),
        ([header, *iterations[1:], end], "iteration 1 is missing"),
        ([header, iterations[0], *iterations, end], "iteration 2 is missing"),
        ([header, *iterations, end, end], "holds what no run writes there"),
        ([header, *iterations, end, iterations[-1]], "holds what no run writes there"),
        ([header, header, *iterations, end], "holds what no run writes there"),
        ([header, b"X", *iterations, end], "holds what no run writes there"),
        ([header, b"I", *iterations, end], "iteration 1"),
    ):
        (tmp_path / "b.vfrun").write_bytes(MAGIC + b"".join(map(framed, bodies)))
        for with_iterations in (True, False):
            assert expected in refused(tmp_path / "b.vfrun", with_iterations), expected


def test_zeros_are_no_entries(tmp_path: Path) -> None:
    """As a file system leaves them that had no time to write; each eight of them are a length and its checksum."""
    run = run_file(tmp_path / "a.vfrun", SHORT)
    content = (tmp_path / "a.vfrun").read_bytes()
    end = framed(bodies_of(tmp_path / "a.vfrun")[-1])
    for changed, is_complete in (
        (content + bytes(800), True),
        (content.removesuffix(end) + bytes(800), False),
        (content.removesuffix(end) + bytes(800) + end, False),
    ):
        (tmp_path / "a.vfrun").write_bytes(changed)
        record = read_run_file(tmp_path / "a.vfrun")
        assert (len(record.iterations), record.is_complete, record.damaged) == (run.length, is_complete, False)


ANSWERS: list[tuple[dict[str, Any], str]] = [
    ({"frame": "0/2"}, "an answer is about frame '0/2', and the run about 0/1"),
    ({"frame": "x" * 100}, "an answer is about frame 'xxx"),
    ({"T_cam_obj": np.full((4, 4), np.nan)}, "holds NaN"),
    ({"middle_m": np.ones(2)}, "the middle of mug has shape (2,)"),
    ({"best_iteration": 5}, "is of an iteration that is not in the file"),
    ({"worst_iteration": 5}, "is of an iteration that is not in the file"),
    ({"findings": (Finding("pool", "", iteration=5),)}, "is of an iteration that is not in the file"),
    ({"instance_id": 7}, "two answers for instance 7"),
    ({"ms_total": np.inf}, "its answers: Expected `float`"),
]


def test_answers_that_no_run_has_are_damage(tmp_path: Path) -> None:
    for fields, expected in ANSWERS:
        known = {"frame": "0/1", "name": "mug", "status": "ok", "instance_id": 7}
        changed = {**known, "instance_id": 8, **fields}
        with closing(RunFile(tmp_path / "a.vfrun", SHORT)) as file:
            file.begin(RunHeader(FORMAT, "", "0/1", "", {}, ()))
            file.finish(RunEnd(answers=(Answer(**known), Answer(**changed))))
        for with_iterations in (True, False):
            assert expected in refused(file.path, with_iterations), expected


def test_an_answer_that_is_no_pose_is_damage(tmp_path: Path) -> None:
    file = RunFile(tmp_path / "a.vfrun", SHORT)
    for fields, expected in (({"T_cam_obj": 2 * np.eye(4)}, "is not rigid"), ({"add_s_mm": -6.0}, "`float` >= 0.0")):
        file.begin(RunHeader(FORMAT, "", "0/1", "", {}, ()))
        file.finish(RunEnd(answers=(Answer(frame="0/1", name="mug", status="ok", **fields),)))
        assert expected in refused(file.path)


def test_a_disk_that_takes_no_more_is_one_line(tmp_path: Path) -> None:
    with file_limit(1_000), pytest.raises(InputError, match=r"^cannot write .*a\.vfrun: File too large$"):
        new_run(SHORT, box_problem(3, 2), (RunFile(tmp_path / "a.vfrun", SHORT),))
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(InputError, match=r"^cannot write to .*/file: "):
        new_run(SHORT, box_problem(3, 2), (RunFile(tmp_path / "file" / "a.vfrun", SHORT),))
