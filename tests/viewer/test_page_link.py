"""Links to a frame, an object and an iteration: written, read, opened, and refused in one line."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.viewer.conftest import SESSION
from tests.viewer.fake_tools import FakeTools
from tests.viewer.test_batch_browsing import RIR_ROWS, SIR, SIR_ROWS
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.state.batch_gallery import Gallery
from verefine_viz.viewer.state.page_link import PageLink, link_of, read_link

NUMBERS = st.none() | st.integers(0, 999_999_999)


@pytest.fixture
def debugger() -> Debugger:
    return Debugger(SESSION, None, FakeTools)


def opened(debugger: Debugger, link: str) -> Debugger:
    return debugger.carry_out([c.OpenLink(link)])


@given(st.builds(PageLink, st.text(), NUMBERS, NUMBERS, NUMBERS, st.text()))
def test_what_is_written_is_read(link: PageLink) -> None:
    assert read_link(link.text) == link
    assert read_link(f"#{link.text}") == link
    assert link.text.isascii()
    assert " " not in link.text


def test_a_link_is_as_a_user_would_type_it() -> None:
    assert PageLink("3/120", 2, None, 17).text == "frame=3/120&object=2&iteration=17"


@given(st.text(max_size=300))
def test_any_text_is_a_link_or_refused_in_one_line(text: str) -> None:
    try:
        read_link(text)
    except InputError as error:
        assert len(str(error)) < 500  # noqa: PT017


def test_what_is_not_there_is_refused_and_everything_stays(debugger: Debugger) -> None:
    opened(debugger, "frame=0/2&iteration=2")
    for link, why in (
        ("fram=0/1", "unknown part 'fram'; did you mean 'frame'?"),
        ("iteration=-1", "iteration is '-1', expected a number"),
        ("object=mug", "object is 'mug', expected a number"),
        ("frame=0/9", "unknown frame '0/9'; available: 0/1, 0/2"),
        ("run=pir", "unknown run 'pir'"),
    ):
        with pytest.raises(InputError, match=re.escape(why)):
            debugger.apply(c.OpenLink(link))
        assert link_of(debugger).text == "frame=0/2&iteration=2", link


def test_a_link_leads_to_itself_and_so_does_the_log() -> None:
    for link in ("frame=0/1&iteration=0", "frame=0/2&instance=1&iteration=4", "frame=0/2&iteration=3"):
        there = opened(Debugger(SESSION, None, FakeTools), link)
        assert link_of(there).text == there.view().link == link
        again = Debugger(SESSION, None, FakeTools).carry_out(there.log)
        assert link_of(again) == link_of(there), link
        assert not any(isinstance(command, c.OpenLink) for command in there.log), link


class TwoObjects(FakeTools):
    """The boxes of a frame are of two models."""

    def problem(self, frame: str) -> Problem:
        problem = super().problem(frame)
        instances = tuple(replace(i, obj_id=1 + i.instance_id) for i in problem.instances)
        models = {i.obj_id: next(iter(problem.models.values())) for i in instances}
        return replace(problem, instances=instances, models=models)


def test_an_object_is_named_by_its_model_where_it_is_there_once() -> None:
    debugger = opened(Debugger(SESSION, None, TwoObjects), "frame=0/2&object=2&iteration=5")
    assert debugger.options.focus == 1
    assert link_of(debugger).text == "frame=0/2&object=2&iteration=5"
    debugger.carry_out([c.ShowScene()])
    assert link_of(debugger).text == "frame=0/2&iteration=5"


def test_of_a_frame_that_is_there_what_it_lacks_is_said(debugger: Debugger) -> None:
    for link, why in (
        ("frame=0/2&object=9", "frame 0/2: unknown object 9; available: 1"),
        ("frame=0/2&object=1", "frame 0/2 holds object 1 several times"),
        ("frame=0/2&instance=7", "frame 0/2: unknown instance 7; available: 0, 1"),
        ("frame=0/1&iteration=999", "the run has no iteration 999"),
    ):
        opened(debugger, link)
        assert debugger.workspace.frame == read_link(link).frame, link
        assert debugger.message.startswith(why)
        assert debugger.refused, link
        assert debugger.options.focus is None, link


def test_without_an_iteration_the_open_frame_stays_where_it_is(debugger: Debugger) -> None:
    opened(debugger, "frame=0/2&iteration=3")
    opened(debugger, "frame=0/2&instance=1")
    assert link_of(debugger).text == "frame=0/2&instance=1&iteration=3"
    opened(debugger, "frame=0/1")
    assert link_of(debugger).text == "frame=0/1&iteration=0"


def test_in_a_page_of_several_runs_a_link_names_its_run(tmp_path: Path) -> None:
    gallery = Gallery(
        [
            BatchIndex(tmp_path / "a run & b", SESSION, BatchInfo(), RIR_ROWS),
            BatchIndex(tmp_path / "sir", SIR, BatchInfo(), SIR_ROWS),
        ]
    )
    debugger = Debugger(gallery.session("sir"), None, FakeTools, batch=gallery)
    opened(debugger, "frame=0/2&iteration=2&run=a%20run%20%26%20b")
    assert debugger.workspace.tools.session.method.name == "rir"
    assert link_of(debugger).text == "frame=0/2&iteration=2&run=a%20run%20%26%20b"
    assert link_of(opened(debugger, "frame=0/1&run=sir")).run == "sir"
