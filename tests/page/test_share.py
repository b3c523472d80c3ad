"""A run as one file: all that the page asks is in it, the same each time, and nothing of this machine."""

from __future__ import annotations

import base64
import gzip
import os
import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from tests.page.fake_tools import FakeTools
from tests.page.made_batch import make_batch
from verefine_viz.core.errors import Cancelled, InputError
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.page import protocol as p
from verefine_viz.page import share as sharing
from verefine_viz.page.answers_to_wants import MapsAnswer, StoredArray
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.bundle import InlinedBlobs, bundle, part
from verefine_viz.page.share import OF_COLOUR, STEPS, opened, share, shared
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.pixel_maps import maps
from verefine_viz.page.workspace import Checks, Workspace
from verefine_viz.run.run_file import read_run_file
from verefine_viz.run.session_file import load_session

MUG = {"scene": {"source": "demo", "demo": "mug"}, "method": {"name": "rir", "iterations": 2}}


@pytest.fixture(autouse=True)
def fake_parts(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    if "mug" not in request.fixturenames:
        monkeypatch.setattr(sharing, "real_parts", lambda: (FakeTools, Checks()))


def unpacked(html: str, name: str) -> bytes:
    """Return a part of a file."""
    found = re.search(rf'<script type="text/plain" id="{name}">(.*?)</script>', html)
    assert found is not None
    return gzip.decompress(base64.b64decode(found[1]))


def messages_in(html: str) -> list[dict[str, Any]]:
    return msgspec.json.decode(unpacked(html, "page"))["messages"]


def test_a_frame_of_a_batch_is_shared_alike_each_time_and_names_no_place_of_this_machine(tmp_path: Path):
    make_batch(tmp_path / "batch")
    files = [tmp_path / "a.html", tmp_path / "b.html"]
    for file in files:
        share(tmp_path / "batch", file, "0/2", with_scene=False)
    html = files[0].read_text("utf-8")
    assert html == files[1].read_text("utf-8")
    assert str(tmp_path) not in html
    frame = next(message for message in messages_in(html) if message["t"] == "frame")
    assert (frame["frame"], frame["frames"], frame["sessions"]) == ("0/2", ["0/2"], [])
    run = next(message for message in messages_in(html) if message["t"] == "run")
    record = read_run_file(next((tmp_path / "batch" / "runs").glob("*_000002.vfrun")))
    assert [row["stages"][-1]["T"] for row in run["rows"]] == [
        iteration.stages[-1].T_cam_obj.ravel().tolist() for iteration in record.iterations
    ]


@pytest.mark.parametrize("what", ["run file", "record"])
def test_a_run_file_and_a_record_are_shared_alike(tmp_path: Path, what: str):
    make_batch(tmp_path / "batch", frames=["0/1"])
    path = next((tmp_path / "batch" / "runs").glob("*.vfrun"))
    share(path if what == "run file" else read_run_file(path), tmp_path / "a.html", with_scene=False)
    messages = messages_in((tmp_path / "a.html").read_text("utf-8"))
    assert [message["t"] for message in messages] == ["hello", "file", "frame", "branches", "run", "verdict"]


def test_a_folder_whose_name_is_no_text_is_shared(tmp_path: Path):
    folder = tmp_path / os.fsdecode(b"b\xff\x1b[2J")
    make_batch(folder, frames=["0/1"])
    note = share(folder, tmp_path / "a.html", with_scene=False)
    assert note.startswith("Frame 0/1 of")
    assert messages_in((tmp_path / "a.html").read_text("utf-8"))[0]["t"] == "hello"
    message = {"t": "file", "name": folder.name, "in": [{folder.name: 1.5, "n": np.float32(2)}]}
    assert msgspec.json.decode(p.encoded(message)) == {
        "t": "file", "name": "b?\x1b[2J", "in": [{"b?\x1b[2J": 1.5, "n": 2.0}],
    }  # fmt: skip


def test_what_cannot_be_shared_is_refused_in_one_line_and_writes_nothing(tmp_path: Path):
    make_batch(tmp_path / "batch", frames=["0/1"])
    for what, frame, out, words in (
        ("batch", "7/7", "a.html", "7/7"),
        ("batch", None, "batch", "is a folder"),
        ("gone.vfrun", None, "a.html", "does not exist"),
        ("batch/runs/000000_000001.vfrun", "0/2", "a.html", "leave out --frame"),
    ):
        with pytest.raises(InputError, match=words):
            share(tmp_path / what, tmp_path / out, frame, with_scene=False)
    with pytest.raises(InputError, match="expected a run"):
        share(3, tmp_path / "a.html")
    assert not (tmp_path / "a.html").exists()


def test_a_share_that_is_cancelled_ends(tmp_path: Path):
    make_batch(tmp_path / "batch", frames=["0/1"])
    debugger = opened(tmp_path / "batch")
    asked = iter([True, True, True, False])
    with pytest.raises(Cancelled):
        shared(debugger, "", progress=ProgressToken(is_wanted=lambda: next(asked)))


def test_text_of_data_cannot_end_the_part_that_holds_it():
    evil = "</script><script>alert(1)</script><!--"
    text = part("page", [{"t": "note", "text": evil}], ())
    assert text.count("<") == 2  # The element itself.
    assert messages_in(text) == [{"t": "note", "text": evil}]
    assert bundle([], title=evil).count("alert(1)</script>") == 0


@pytest.fixture(scope="module")
def mug(processes: None) -> Debugger:
    from verefine_viz.run.toolbox import Toolbox

    debugger = Debugger(Workspace(load_session(None, MUG), None, Toolbox))
    return debugger.carry_out([p.RunVerb()])


def test_more_maps_hold_all_that_fewer_do(mug: Debugger):
    wants = [{msgspec.json.encode(of) for of, _ in shared(mug, "", how).answers} for how in ("end", "marked", "all")]
    assert wants[0] < wants[1] <= wants[2]
    obj, made = (
        mug.space.problem.targets[0].instance.instance_id,
        mug.space.work.first.run.final_state.best[0].iteration,
    )
    assert msgspec.json.encode({"what": "crops", "branch": 0, "k": made}) in wants[0]
    assert {msgspec.json.encode(of) for of, _ in shared(mug, "", objects=[obj]).answers} == wants[1]
    few = [of for of, _ in shared(mug, "", objects=[]).answers]
    assert [of["what"] for of in few] == ["outlines"]


def test_maps_of_a_file_are_those_of_the_engine_to_the_digits_that_the_page_shows(mug: Debugger):
    run = shared(mug, "", "all")
    elements = "\n".join(run.elements)
    compared = 0
    for of, answer in run.answers:
        if of["what"] != "maps" or of["obj"] is None:
            continue
        exact = Blobs()
        live = maps(mug.space, msgspec.convert(of, p.MapsWanted), exact)
        assert isinstance(answer, MapsAnswer)
        assert answer.score == live.score
        sent, data = unpacked(elements, f"blob {answer.blob}"), exact.data(live.blob)
        for one, whole in zip(answer.arrays, live.arrays, strict=True):
            step = one.step
            values = np.frombuffer(sent, one.dtype, one.n, one.offset)
            true = np.frombuffer(data, whole.dtype, whole.n, whole.offset)
            if step is None:
                assert np.array_equal(values, true, equal_nan=True)
            else:
                assert step <= STEPS[one.name][0]
                gone = values == np.iinfo(values.dtype).max
                assert np.array_equal(gone, ~np.isfinite(true))
                assert np.abs(step * values[~gone] - true[~gone]).max(initial=0) <= 0.51 * step
            compared += 1
    assert compared > 50


@pytest.mark.parametrize("weight", [0.0, 0.1])
def test_maps_of_colour_are_in_a_file_where_colour_counts(processes: None, weight: float):
    from verefine_viz.run.toolbox import Toolbox

    session = load_session(None, {**MUG, "score": {"colour_weight": weight}})
    debugger = Debugger(Workspace(session, None, Toolbox)).carry_out([p.RunVerb()])
    made = [answer for _, answer in shared(debugger, "", "end").answers if isinstance(answer, MapsAnswer)]
    assert made
    assert all({one.name for one in answer.arrays}.issuperset(OF_COLOUR) == (weight > 0) for answer in made)


def test_far_depth_is_held_with_fewer_digits_rather_than_cut():
    exact, far = Blobs(), np.array([0.0, 20.0, np.nan, 3.0], np.float32)
    key = exact.put(far.tobytes())
    arrays, blobs = [StoredArray("rendered", "float32", 0, 4)], InlinedBlobs()
    blob, (one,) = sharing._rounded(exact.data(key), arrays, blobs)
    values = np.frombuffer(unpacked("".join(blobs.elements), f"blob {blob}"), one.dtype, one.n, one.offset)
    assert values[2] == np.iinfo(values.dtype).max
    step = one.step or 0.0
    assert step * values[[0, 1, 3]] == pytest.approx([0, 20, 3], abs=step)


def test_a_session_is_run_to_its_end(tmp_path: Path):
    from verefine_viz.run.session_file import save_session

    save_session(msgspec.convert({"method": {"name": "rir", "refiner": "identity", "iterations": 3}}, Session),
                 tmp_path / "s.toml")  # fmt: skip
    branch = opened(tmp_path / "s.toml").space.work.first
    assert branch.is_over
