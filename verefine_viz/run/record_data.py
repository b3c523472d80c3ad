"""A recorded run together with the data that it was made on: its session, its frame, and itself to step through."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from msgspec import structs

from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.estimators.registry import ESTIMATORS
from verefine_viz.run.engine import Run
from verefine_viz.run.record import RunHeader, RunRecord
from verefine_viz.run.run_header import session_of
from verefine_viz.run.session_parts import estimators_of
from verefine_viz.run.toolbox import Toolbox

MakeTools = Callable[[Session], Toolbox]


def session_on_its_frame(header: RunHeader) -> Session:
    """The session that makes the same run, on its frame alone.

    Raises:
        SettingsError: it is damaged, or this version cannot run it.
    """
    session = session_of(header)
    return structs.replace(session, scene=structs.replace(session.scene, frames=(header.frame,)))


def recorded_problem(record: RunRecord, tools: Toolbox, make_tools: MakeTools) -> Problem:
    """The frame of a record; with the initial poses of the record where their estimator is not there.

    Raises:
        VerefineError: it cannot be read.
    """
    frame, session = record.header.frame, tools.session
    if not estimators_of(session) - ESTIMATORS.keys():
        return tools.problem(frame)
    hypotheses = structs.replace(session.hypotheses, source="recorded", estimate=())
    problem = make_tools(structs.replace(session, hypotheses=hypotheses)).problem(frame)
    pools = {one.instance_id: one.hypotheses for one in record.header.objects}
    instances = (replace(i, hypotheses=pools.get(i.instance_id, ())) for i in problem.instances)
    return replace(problem, instances=tuple(instances))


def recorded_run(record: RunRecord, tools: Toolbox, problem: Problem) -> Run:
    """The run of a record on its frame, with the cursor before its first iteration; a fork begins it again.

    Raises:
        InputError: the frame does not hold what was recorded.
    """
    ids = [one.instance_id for one in record.header.objects]
    return Run.from_record(record, problem, again=lambda: tools.run(problem.only(ids)))
