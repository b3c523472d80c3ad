"""The beginning of a run's record, its header; and the whole record of a frame that could not be solved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

from verefine_viz.core.errors import SettingsError
from verefine_viz.core.problem import LeftOut, Problem
from verefine_viz.core.settings import Session
from verefine_viz.run.record import FORMAT, Answer, ObjectHeader, RunEnd, RunHeader, RunRecord, unsolved
from verefine_viz.run.session_file import parsed_toml, resolve, session_toml
from verefine_viz.run.versions import versions

if TYPE_CHECKING:
    from verefine_viz.core.protocols import RunState

NO_WEIGHTS: Mapping[str, str] = MappingProxyType({})
"""Weights of a run without learned parts."""


def failed_run(
    session: Session, weights: Mapping[str, str], frame: str, message: str, objects: Sequence[LeftOut] = ()
) -> RunRecord:
    """The record of a frame that could not be solved, with an answer about each object that is known to be in it.

    ``weights`` as in :func:`header_of`.
    """
    message, method, seed = " ".join(message.split()), session.method.name, session.hypotheses.seed
    answers = tuple(unsolved(frame, one, "failed", message, method, seed) for one in objects)
    if not answers:
        answers = (Answer(frame=frame, method=method, seed=seed, status="failed", message=message),)
    header = RunHeader(FORMAT, session_toml(session), frame, session.title, versions(weights), ())
    return RunRecord(header, (), RunEnd(answers=answers))


def header_of(problem: Problem, state: RunState | None, session: Session, weights: Mapping[str, str]) -> RunHeader:
    """The header of a run.

    Args:
        problem: the frame.
        state: of the run before the first iteration; None where no scores are known.
        session: what it is a run of.
        weights: hashes of its weights by name, as :func:`verefine_viz.run.session_parts.weights_of` has them.
    """
    support = problem.observation.support
    initial = [None] * len(problem.targets) if state is None else state.initial
    objects = tuple(
        ObjectHeader(
            target.instance.instance_id,
            target.instance.obj_id,
            target.model.name,
            target.model.diameter_m,
            target.instance.T_cam_obj_gt,
            target.instance.hypotheses,
            () if scores is None else tuple(scores[j] for j in range(len(scores))),
        )
        for target, scores in zip(problem.targets, initial, strict=True)
    )
    return RunHeader(
        FORMAT,
        session_toml(session),
        problem.frame,
        session.title or problem.title,
        versions(weights),
        objects,
        problem.observation.T_map_cam,
        None if support is None else support.T_world_cam,
        problem.notes,
    )


def session_of(header: RunHeader) -> Session:
    """The session that repeats a run.

    Raises:
        SettingsError: it is damaged, or this version cannot run it.
    """
    try:
        raw = parsed_toml(header.session)
    except ValueError:
        raise SettingsError("the session of the run is no TOML") from None
    return resolve(raw, "the session of the run")
