"""The film of an object: its key moments as in the verdict, and their pictures: answer to the want ``film``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, get_args

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.finding import Finding
from verefine_viz.core.moment import Moment, MomentLayer
from verefine_viz.core.problem import Target
from verefine_viz.core.scores import MAP_NAMES, ScoreMaps
from verefine_viz.diagnosis.key_moments import key_moments
from verefine_viz.diagnosis.signs import FinishedObject
from verefine_viz.page.answers_to_wants import FilmAnswer
from verefine_viz.page.protocol import MomentDrawn, pose_matrix
from verefine_viz.page.run_messages import MomentShown
from verefine_viz.page.wire import pose_numbers
from verefine_viz.run.record import Answer, RunRecord

if TYPE_CHECKING:
    from verefine_viz.page.blobs import Blobs
    from verefine_viz.page.branch import Branch
    from verefine_viz.page.protocol import FilmWanted
    from verefine_viz.page.workspace import Workspace

MapsOf = Callable[[Moment, Float], ScoreMaps | None]
PicturesOf = Callable[[Target, Sequence[Moment], MapsOf, float], list[bytes]]
"""Draws moments as WebP: ``pictures/film.py``."""


def film(space: Workspace, want: FilmWanted, blobs: Blobs, pictures_of: PicturesOf) -> FilmAnswer:
    """The answer to a want of a film: a picture for each moment.

    Raises:
        InputError: there is no such branch, object or map.
    """
    branch, target = space.branch(want.branch), space.problem.target(want.obj)
    moments = [_moment(one, want.obj) for one in want.moments]
    drawn = pictures_of(target, moments, maps_in(branch, target), tau_m_of(branch))
    return FilmAnswer([f"/blob/{blobs.put(one, 'image/webp')}" for one in drawn])


def _moment(drawn: MomentDrawn, obj: int) -> Moment:
    if drawn.map not in MAP_NAMES or not drawn.poses:
        raise InputError(unknown("map", drawn.map, MAP_NAMES) if drawn.poses else "a moment without a pose")
    poses = tuple((role, pose_matrix(T)) for role, T in drawn.poses)
    layer: MomentLayer = drawn.layer if drawn.layer in get_args(MomentLayer) else ""  # type: ignore[assignment]
    return Moment("answer", drawn.k, obj, None, poses, "", drawn.map, layer=layer)


def maps_in(branch: Branch, target: Target) -> MapsOf:
    """Return a function for the score maps at the poses of a branch's moments."""
    return lambda moment, T: branch.evaluator_of(moment.iteration).maps(target, T)


def tau_m_of(branch: Branch) -> float:
    """The depth tolerance of a branch's score [m]."""
    return branch.final_evaluator.verifier.settings.tau_m


def moments_of(
    branch: Branch, record: RunRecord, o: FinishedObject, findings: Sequence[Finding], other: Float | None
) -> tuple[Moment, ...]:
    """The key moments of an object of a finished run.

    Args:
        branch: the run.
        record: of it.
        o: the object's outcome.
        findings: the verdict's, the main one first.
        other: a pose (4, 4) elsewhere that fits as well.
    """
    best, own = o.answer, next(one for one in record.header.objects if one.instance_id == o.instance_id)
    if best is None:
        return ()
    first = int(np.argmax([score.score for score in own.initial])) if own.initial else 0
    start = o.starts[first] if first < len(o.starts) else None
    answer = Answer(
        frame=record.header.frame,
        instance_id=o.instance_id,
        status="ok",
        T_cam_obj=best.T_cam_obj,
        score=best.score.score,
        add_s_mm=None if o.errors is None else o.errors.add_s_mm,
        initial_add_s_mm=None if start is None else start.add_s_mm,
        best_hypothesis=best.arm + 1,
        best_iteration=best.iteration,
        undetermined_deg=None if o.allowed is None else o.allowed.undetermined_deg,
        findings=tuple(findings),
        doubts=tuple(doubt.title for doubt in branch.doubts() if doubt.concerns(o.instance_id)),
    )
    return key_moments(record, answer, other)


def shown_moment(moment: Moment) -> MomentShown:
    """A moment as in the verdict."""
    poses = tuple((role, pose_numbers(T)) for role, T in moment.poses)
    drawn = MomentDrawn(moment.iteration, poses, moment.map, moment.layer)
    legend = list(moment.legend.items())
    return MomentShown(moment.iteration, moment.stage, moment.title, moment.caption, legend, drawn)
