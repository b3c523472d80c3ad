"""The gallery of failures: pictures, how the score went, and why it went wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from verefine_viz.batch.rows import ObjectRow
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.problem import Problem
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.row import Row
from verefine_viz.report.loaded import Loaded, frame_of, key
from verefine_viz.report.pictures import Pictures, pictures
from verefine_viz.scenes.source import SceneSource, open_scene


@dataclass(frozen=True)
class Curve:
    """One object over the iterations that were spent on it."""

    iterations: tuple[int, ...]
    """Counted over the frame, as everywhere."""
    arms: tuple[int, ...]
    scores: tuple[float | None, ...]
    """Of the pose that was kept."""
    best_scores: tuple[float, ...]
    """Best so far."""
    best_errors_mm: tuple[float | None, ...]
    """ADD(-S) of the best so far."""


@dataclass(frozen=True)
class Failure:
    """One card of the gallery."""

    row: ObjectRow
    other: ObjectRow | None
    """The same object in the other run."""
    pictures: Pictures | None
    curve: Curve | None


@dataclass(frozen=True)
class Gallery:
    """The worst answers of a run."""

    failures: tuple[Failure, ...]
    n_more: int
    """Failures beyond those shown."""
    notes: tuple[str, ...]
    """What is missing, and why."""


def gallery(run: Loaded, other: Loaded | None, most: int, tell: Callable[[int, int], None]) -> Gallery:
    """The failures of a run, worst first.

    Args:
        run: whose failures.
        other: another run to show beside it.
        most: how many are shown.
        tell: told how many frames are done, and how many there are.
    """
    shown = run.failures[:most]
    theirs = {key(row): row for row in other.objects} if other else {}
    found: dict[int, Failure] = {}
    notes: list[str] = []
    frames = list(dict.fromkeys(frame_of(row) for row in shown))
    source = _Source(run, notes) if shown else None
    for done, frame in enumerate(frames):
        tell(done, len(frames))
        rows = [row for row in shown if frame_of(row) == frame]
        answers = [(run, run.answers(frame))] + ([(other, other.answers(frame))] if other else [])
        problem = source.problem(frame) if source else None
        curves = _curves(run, frame, notes)
        for row in rows:
            seen = _pictures(run, problem, row, answers)
            found[id(row)] = Failure(row, theirs.get(key(row)), seen, curves.get(row.instance_id))
    tell(len(frames), len(frames))
    cards = tuple(found[id(row)] for row in shown)
    return Gallery(cards, len(run.failures) - len(shown), tuple(dict.fromkeys(notes)))


class _Source:
    """Frames of the run's data set; one note says why there are none."""

    def __init__(self, run: Loaded, notes: list[str]) -> None:
        self._notes, self._source = notes, _opened(run, notes)

    def problem(self, frame: str) -> Problem | None:
        if self._source is None:
            return None
        try:
            return self._source.problem(frame)
        except VerefineError as error:
            self._notes.append(f"No pictures of frame {frame}: {error}.")
            return None


def _opened(run: Loaded, notes: list[str]) -> SceneSource | None:
    session = run.index.session
    try:
        # Pictures need no first poses, whose files may be gone.
        hypotheses = session.hypotheses.model_copy(update={"source": "perturb", "estimate": ()})
        scene = session.scene.model_copy(update={"frames": run.frames})
        return open_scene(scene, hypotheses)
    except VerefineError as error:
        notes.append(f"No pictures: {error}.")
        return None


def _pictures(
    run: Loaded,
    problem: Problem | None,
    row: ObjectRow,
    answers: Sequence[tuple[Loaded, Mapping[int, Float]]],
) -> Pictures | None:
    if problem is None or row.instance_id is None:
        return None
    target = next((t for t in problem.targets if t.instance.instance_id == row.instance_id), None)
    if target is None or target.instance.obj_id != row.obj_id:
        return None
    poses = [(found[row.instance_id], r.label or "best") for r, found in answers if row.instance_id in found]
    return pictures(target, poses, run.index.session.score.tau_m)


def _curves(run: Loaded, frame: str, notes: list[str]) -> dict[int | None, Curve]:
    path = run.recording(frame)
    if not path.is_file():
        notes.append("Some frames have no recording (recording.keep), and so no curve.")
        return {}
    try:
        recorded = read_recording(path)
    except VerefineError as error:
        notes.append(f"No curves of frame {frame}: {error}.")
        return {}
    ids = dict.fromkeys(row.instance_id for row in recorded.rows)
    return {i: _curve([row for row in recorded.rows if row.instance_id == i]) for i in ids}


def _curve(rows: Sequence[Row]) -> Curve:
    return Curve(
        tuple(row.index for row in rows),
        tuple(row.arm for row in rows),
        tuple(_known(row.score(row.accepted)) for row in rows),
        tuple(_running_best(rows)),
        tuple(_known(float(row.errors[2])) for row in rows),
    )


def _running_best(rows: Sequence[Row]) -> Iterator[float]:
    for row in rows:
        yield float(row.best_score[0])


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value
