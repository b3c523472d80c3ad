"""The gallery of failures: which answers get a card, with pictures, the score over the iterations, and the cause."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from verefine_viz.batch.answer_tags import answer_key, read_tags
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.records import Iteration
from verefine_viz.diagnosis.causes import cause_title
from verefine_viz.evaluation.landscape import Curve, landscape
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.pictures.answer_pictures import Pictures, picture_source, pictures
from verefine_viz.pictures.landscape_picture import worst_curves
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.report.groups import Group, Progress, seed_words
from verefine_viz.report.run_results import Key, LoadedRun, key
from verefine_viz.run.record import Answer
from verefine_viz.run.run_file import read_run_file
from verefine_viz.scenes.source import SceneSource

ONLY_A, ONLY_B, BOTH = "only A wrong", "only B wrong", "both wrong"
"""Groups of failures where two runs are compared."""


@dataclass(frozen=True)
class ScoreCurve:
    """One object over the iterations that were spent on it."""

    iterations: tuple[int, ...]
    """Counted over the frame, as everywhere."""
    arms: tuple[int, ...]
    scores: tuple[float | None, ...]
    """Of the accepted pose."""
    best_scores: tuple[float, ...]
    """Best so far."""
    best_errors_mm: tuple[float | None, ...]
    """ADD(-S) of the best so far."""


@dataclass(frozen=True)
class Pick:
    """An answer that gets a card."""

    run: LoadedRun
    row: Answer
    other: LoadedRun | None = None
    """Another run to show beside it."""
    group: str = ""
    """Of runs, where several groups are compared; who is wrong, where two runs are."""
    remark: str = ""
    """What else to know about it."""

    @property
    def place(self) -> tuple[str, Key]:
        """Group and object: no two cards have the same."""
        return self.group, key(self.row)

    @property
    def badness(self) -> float:
        """What is worst comes first: no answer, then the error; without ground truth the lowest score."""
        if self.row.status != "ok":
            return math.inf
        error = self.row.relative_error
        return error if error is not None else -(self.row.score or 0.0)


@dataclass(frozen=True)
class Failure:
    """One card of the gallery."""

    pick: Pick
    other: Answer | None
    """The same object in the other run."""
    pictures: Pictures | None
    curve: ScoreCurve | None
    around: tuple[Curve, Curve] | None = None
    """The score around the answer along the shift and the turn that are least certain."""
    tags: tuple[str, ...] = ()
    """Of the user's, from the run's tags.json."""

    @property
    def row(self) -> Answer:
        return self.pick.row

    @property
    def causes(self) -> tuple[str, ...]:
        """Why it failed; in the other run too, if it is wrong there."""
        return tuple(dict.fromkeys(row.cause for row in (self.row, self.other) if row is not None and row.cause))


@dataclass(frozen=True)
class Gallery:
    """The worst answers of a run, or of several."""

    failures: tuple[Failure, ...]
    n_more: int
    """Failures beyond those shown."""
    notes: tuple[str, ...]
    """What is missing, and why."""


def gallery(run: LoadedRun, most: int, progress: Progress) -> Gallery:
    """The failures of a run, worst first, at most ``most``."""
    return gallery_of([Pick(run, row) for row in run.failures[:most]], len(run.failures), progress)


def gallery_of(picks: Sequence[Pick], n_failures: int, progress: Progress) -> Gallery:
    """The cards of some of ``n_failures`` answers, in their order; the runs share their data: a frame is read once."""
    cards: dict[int, Failure] = {}
    notes: list[str] = []
    frames = list(dict.fromkeys(pick.row.frame for pick in picks))
    source = _opened(picks[0].run, frames, notes) if picks else None
    for frame in frames:
        problem = _problem(source, frame, notes)
        of_frame = [(k, pick) for k, pick in enumerate(picks) if pick.row.frame == frame]
        runs = {id(pick.run): pick for _, pick in of_frame}
        answers = {i: _answers(pick, frame) for i, pick in runs.items()}
        curves = {i: _curves(pick.run, frame, problem, notes) for i, pick in runs.items()}
        for k, pick in of_frame:
            progress(len(cards), len(picks))
            drawn = _pictures(pick.run, problem, pick.row, answers[id(pick.run)])
            other = None if pick.other is None else pick.other.row_of(pick.row)
            curve = curves[id(pick.run)].get(pick.row.instance_id)
            around = _least_certain(pick.run, problem, pick.row, answers[id(pick.run)][0][1])
            cards[k] = Failure(pick, other, drawn, curve, around, _tags(pick, notes))
    progress(len(picks), len(picks))
    in_order = tuple(cards[k] for k in range(len(picks)))
    return Gallery(in_order, n_failures - len(picks), tuple(dict.fromkeys(notes)))


def _tags(pick: Pick, notes: list[str]) -> tuple[str, ...]:
    try:
        return read_tags(pick.run.index.folder).tags.get(answer_key(pick.row), ())
    except InputError as error:
        notes.append(f"No tags: {error}.")
        return ()


def _answers(pick: Pick, frame: str) -> list[tuple[LoadedRun, Mapping[int, Float]]]:
    runs = [pick.run] if pick.other is None else [pick.run, pick.other]
    return [(run, run.index.answers(frame)) for run in runs]


def _opened(run: LoadedRun, frames: Sequence[str], notes: list[str]) -> SceneSource | None:
    try:
        return picture_source(run.index.session, frames)
    except VerefineError as error:
        notes.append(f"No pictures: {error}.")
        return None


def _problem(source: SceneSource | None, frame: str, notes: list[str]) -> Problem | None:
    if source is None:
        return None
    try:
        return source.problem(frame)
    except VerefineError as error:
        notes.append(f"No pictures of frame {frame}: {error}.")
        return None


def _pictures(
    run: LoadedRun,
    problem: Problem | None,
    row: Answer,
    answers: Sequence[tuple[LoadedRun, Mapping[int, Float]]],
) -> Pictures | None:
    target = _target(problem, row)
    if target is None or row.instance_id is None:
        return None
    poses = [(Ts[row.instance_id], r.label or "best") for r, Ts in answers if row.instance_id in Ts]
    return pictures(target, poses, run.index.session.score.tau_m)


def _target(problem: Problem | None, row: Answer) -> Target | None:
    """The object of a row in its frame; None where the data have another one by now."""
    targets = () if problem is None else problem.targets
    own = next((t for t in targets if t.instance.instance_id == row.instance_id), None)
    return own if own is not None and own.instance.obj_id == row.obj_id else None


def _least_certain(
    run: LoadedRun, problem: Problem | None, row: Answer, answers: Mapping[int, Float]
) -> tuple[Curve, Curve] | None:
    target = _target(problem, row)
    if target is None or row.instance_id is None or row.instance_id not in answers:
        return None
    return worst_curves(landscape(CpuVerifier(run.index.session.score), target, answers[row.instance_id]))


def _curves(run: LoadedRun, frame: str, problem: Problem | None, notes: list[str]) -> dict[int | None, ScoreCurve]:
    try:
        iterations = read_run_file(run.runs.path(frame)).iterations
    except VerefineError as error:
        notes.append(f"No curves of frame {frame}: {error}.")
        return {}
    targets = {} if problem is None else {t.instance.instance_id: t for t in problem.targets}
    ids = dict.fromkeys(i.instance_id for i in iterations)
    return {k: _curve([i for i in iterations if i.instance_id == k], targets.get(k)) for k in ids}


def _curve(iterations: Sequence[Iteration], target: Target | None) -> ScoreCurve:
    @cache
    def error_mm(pose: bytes) -> float | None:
        """ADD(-S) of a T_cam_obj; the best pose seldom changes."""
        if target is None or target.instance.T_cam_obj_gt is None:
            return None
        return add_s_mm(target.model, np.frombuffer(pose).reshape(4, 4), target.instance.T_cam_obj_gt)

    accepted = [i.accepted_stage.score for i in iterations]
    return ScoreCurve(
        tuple(i.index for i in iterations),
        tuple(i.arm for i in iterations),
        tuple(None if score is None else score.score for score in accepted),
        tuple(i.best.score.score for i in iterations),
        tuple(error_mm(i.best.T_cam_obj.tobytes()) for i in iterations),
    )


def group_gallery(groups: Sequence[Group], most: int, progress: Progress) -> Gallery:
    """The worst failures of each group, as many of each; an object comes once a group, with its worst seed.

    ``most`` counts all groups together; what does not divide evenly goes to the first ones.
    """
    shares = [most // len(groups) + (k < most % len(groups)) for k in range(len(groups))]
    picks = [pick for group, share in zip(groups, shares, strict=True) for pick in _picks(group, share)]
    picks.sort(key=lambda pick: -pick.badness)
    n_failures = sum(len(run.failures) for group in groups for run in group.runs)
    return gallery_of(picks, n_failures, progress)


def _picks(group: Group, most: int) -> list[Pick]:
    failed: dict[Key, list[Pick]] = {}
    for run in group.runs:
        for row in run.failures:
            failed.setdefault(key(row), []).append(Pick(run, row, group=group.name, remark=_remark(run)))
    worst = [max(mine, key=lambda pick: pick.badness) for mine in failed.values()]
    worst.sort(key=lambda pick: -pick.badness)
    return [replace(p, remark=f"{p.remark} · {_often(failed[key(p.row)], len(group.runs))}") for p in worst[:most]]


def _often(failed: Sequence[Pick], n_runs: int) -> str:
    """``wrong in 12 of 20 runs: best hypothesis tried too little 9, collider too coarse 3``."""
    often = f"wrong in {len(failed)} of {n_runs} runs"
    causes = Counter(pick.row.cause for pick in failed if pick.row.cause).most_common()
    if len(failed) < 2 or not causes:
        return often
    return f"{often}: {', '.join(f'{cause_title(cause)} {n}' for cause, n in causes)}"


def _remark(run: LoadedRun) -> str:
    return f"{run.folder.name} ({seed_words(run)})"


def pair_gallery(a: LoadedRun, b: LoadedRun, most: int, progress: Progress) -> Gallery:
    """What the runs got wrong, an object once, worst first; what only one got wrong is shown as often as what both did.

    Without ground truth it is unknown what is wrong: then the lowest scores of A.
    """
    if not a.with_truth and not b.with_truth:
        return gallery_of([Pick(a, row, b) for row in a.failures[:most]], len(a.failures), progress)
    wrong = _wrong(a, b)
    shares = shared_out(most, [len(picks) for picks in wrong])
    shown = [pick for picks, share in zip(wrong, shares, strict=True) for pick in picks[:share]]
    shown.sort(key=lambda pick: -pick.badness)
    return gallery_of(shown, sum(map(len, wrong)), progress)


def shared_out(most: int, sizes: Sequence[int]) -> list[int]:
    """How many each of several lists may show: the same, and what one does not need goes to the others."""
    shares = [0] * len(sizes)
    for _ in range(max(sizes, default=0)):
        for k, size in enumerate(sizes):
            if shares[k] < size and sum(shares) < most:
                shares[k] += 1
    return shares


def _wrong(a: LoadedRun, b: LoadedRun) -> list[list[Pick]]:
    """What only A, only B and both got wrong, each worst first; a card is that of the run whose answer is worse."""
    of_a, of_b = ({key(row): row for row in run.failures} for run in (a, b))
    both = [max(Pick(a, row, b, BOTH), Pick(b, of_b[k], a, BOTH), key=lambda pick: pick.badness)
            for k, row in of_a.items() if k in of_b]  # fmt: skip
    both.sort(key=lambda pick: -pick.badness)
    return [_alone(a, b, ONLY_A), _alone(b, a, ONLY_B), both]


def _alone(run: LoadedRun, other: LoadedRun, kind: str) -> list[Pick]:
    """What ``run`` got wrong and ``other`` did not."""
    theirs = {key(row) for row in other.failures}
    return [Pick(run, row, other, kind, _absent(other, row)) for row in run.failures if key(row) not in theirs]


def _absent(other: LoadedRun, row: Answer) -> str:
    """Why the other run has no answer for an object; empty where it has."""
    other_row = other.row_of(row)
    if other_row is None:
        return f"{other.label} does not have it"
    return "" if other_row.was_asked_for else f"{other.label} was not asked for it: {other_row.message}"
