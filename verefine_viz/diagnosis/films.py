"""The films of the answers of a recorded run, by object."""

from __future__ import annotations

from collections.abc import Callable

from verefine_viz.core.problem import Problem
from verefine_viz.core.protocols import Verifier
from verefine_viz.diagnosis.key_moments import key_moments
from verefine_viz.pictures.film import Film
from verefine_viz.run.record import RunRecord


def films_of(record: RunRecord, problem: Problem, verifier_of: Callable[[int], Verifier]) -> dict[int, Film]:
    """The films of all answers of a finished run, by instance; pictures are made when asked for.

    Args:
        record: the run.
        problem: its frame.
        verifier_of: the verifier that scored iteration k.
    """
    films = {}
    for answer in record.end.answers if record.end is not None else ():
        moments = key_moments(record, answer) if answer.instance_id is not None else ()
        if moments and answer.instance_id is not None:
            target, last = problem.target(answer.instance_id), verifier_of(record.iterations[-1].index)
            films[answer.instance_id] = Film(
                target,
                moments,
                lambda moment, T, target=target: verifier_of(moment.iteration).maps(target, T),
                last.settings.tau_m,
            )
    return films
