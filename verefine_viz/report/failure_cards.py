"""The gallery of failures: pictures, how the score went, and why it went wrong."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from verefine_viz.batch.rows import ObjectRow
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.problem import Problem
from verefine_viz.diagnosis.causes import cause_title
from verefine_viz.pictures.answers import Pictures, picture_source, pictures
from verefine_viz.recording.lossless_log import Entry
from verefine_viz.recording.reader import read_recording
from verefine_viz.report.groups import Group, seed_words
from verefine_viz.report.run_results import Key, Loaded, key
from verefine_viz.scenes.source import SceneSource


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
class Pick:
    """An answer that gets a card."""

    run: Loaded
    row: ObjectRow
    other: Loaded | None = None
    """Another run to show beside it."""
    group: str = ""
    """Of runs, where several groups are compared; who is wrong, where two runs are."""
    remark: str = ""
    """What else to say about it."""

    @property
    def place(self) -> tuple[str, Key]:
        """What no two cards have in common: group and object."""
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
    other: ObjectRow | None
    """The same object in the other run."""
    pictures: Pictures | None
    curve: Curve | None

    @property
    def row(self) -> ObjectRow:
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


def gallery(run: Loaded, most: int, tell: Callable[[int, int], None]) -> Gallery:
    """The failures of a run, worst first.

    Args:
        run: whose failures.
        most: how many are shown.
        tell: told how many cards are done, and how many there are.
    """
    return gallery_of([Pick(run, row) for row in run.failures[:most]], len(run.failures), tell)


def gallery_of(picks: Sequence[Pick], n_failures: int, tell: Callable[[int, int], None]) -> Gallery:
    """The cards of some answers, in their order; all runs are about the same data, so a frame is read once.

    Args:
        picks: the answers.
        n_failures: how many there are to pick from.
        tell: told how many cards are done, and how many there are.
    """
    found: dict[int, Failure] = {}
    notes: list[str] = []
    frames = list(dict.fromkeys(pick.row.frame for pick in picks))
    source = _Source(picks[0].run, frames, notes) if picks else None
    for frame in frames:
        problem = source.problem(frame) if source else None
        mine = [(k, pick) for k, pick in enumerate(picks) if pick.row.frame == frame]
        runs = {id(pick.run): pick for _, pick in mine}
        answers = {i: _answers(pick, frame) for i, pick in runs.items()}
        curves = {i: _curves(pick.run, frame, notes) for i, pick in runs.items()}
        for k, pick in mine:
            tell(len(found), len(picks))
            seen = _pictures(pick.run, problem, pick.row, answers[id(pick.run)])
            theirs = None if pick.other is None else pick.other.row_of(pick.row)
            found[k] = Failure(pick, theirs, seen, curves[id(pick.run)].get(pick.row.instance_id))
    tell(len(picks), len(picks))
    cards = tuple(found[k] for k in range(len(picks)))
    return Gallery(cards, n_failures - len(picks), tuple(dict.fromkeys(notes)))


def _answers(pick: Pick, frame: str) -> list[tuple[Loaded, Mapping[int, Float]]]:
    runs = [pick.run] if pick.other is None else [pick.run, pick.other]
    return [(run, run.answers(frame)) for run in runs]


class _Source:
    """Frames of the run's data set; one note says why there are none."""

    def __init__(self, run: Loaded, frames: Sequence[str], notes: list[str]) -> None:
        self._notes, self._source = notes, _opened(run, frames, notes)

    def problem(self, frame: str) -> Problem | None:
        if self._source is None:
            return None
        try:
            return self._source.problem(frame)
        except VerefineError as error:
            self._notes.append(f"No pictures of frame {frame}: {error}.")
            return None


def _opened(run: Loaded, frames: Sequence[str], notes: list[str]) -> SceneSource | None:
    try:
        return picture_source(run.index.session, frames)
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
    ids = dict.fromkeys(i.instance_id for i in recorded.iterations)
    return {k: _curve([e for e in recorded.entries if e.iteration.instance_id == k]) for k in ids}


def _curve(entries: Sequence[Entry]) -> Curve:
    iterations = [entry.iteration for entry in entries]
    kept = [i.accepted_stage.score for i in iterations]
    errors_mm = [float(entry.errors[2]) for entry in entries]
    return Curve(
        tuple(i.index for i in iterations),
        tuple(i.arm for i in iterations),
        tuple(None if score is None else score.score for score in kept),
        tuple(i.best.score.score for i in iterations),
        tuple(None if math.isnan(e) else e for e in errors_mm),
    )


# Which failures of several groups get a card.


def group_gallery(groups: Sequence[Group], most: int, tell: Callable[[int, int], None]) -> Gallery:
    """The worst failures of each group, as many of each; an object comes once a group, with its worst seed.

    Args:
        groups: in the order in which they take what does not divide evenly.
        most: cards of all groups together.
        tell: told how many cards are done, and how many there are.
    """
    shares = [most // len(groups) + (k < most % len(groups)) for k in range(len(groups))]
    picks = [pick for group, share in zip(groups, shares, strict=True) for pick in _picks(group, share)]
    picks.sort(key=lambda pick: -pick.badness)
    n_failures = sum(len(run.failures) for group in groups for run in group.runs)
    return gallery_of(picks, n_failures, tell)


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
    said = f"wrong in {len(failed)} of {n_runs} runs"
    causes = Counter(pick.row.cause for pick in failed if pick.row.cause).most_common()
    if len(failed) < 2 or not causes:
        return said
    return f"{said}: {', '.join(f'{cause_title(cause)} {n}' for cause, n in causes)}"


def _remark(run: Loaded) -> str:
    return f"{run.folder.name} ({seed_words(run)})"


# Which objects get a card where two runs are compared: those that one of them, or both, got wrong.

ONLY_A, ONLY_B, BOTH = "only A wrong", "only B wrong", "both wrong"


def pair_gallery(a: Loaded, b: Loaded, most: int, tell: Callable[[int, int], None]) -> Gallery:
    """What the runs got wrong, an object once, worst first; what only one got wrong is shown as often as what both did.

    Without ground truth nobody knows what is wrong: then the lowest scores of A.

    Args:
        a: one run.
        b: the other.
        most: how many are shown.
        tell: told how many cards are done, and how many there are.
    """
    if not a.with_truth and not b.with_truth:
        return gallery_of([Pick(a, row, b) for row in a.failures[:most]], len(a.failures), tell)
    found = _wrong(a, b)
    shown = [pick for picks, n in zip(found, shared_out(most, [len(mine) for mine in found]), strict=True)
             for pick in picks[:n]]  # fmt: skip
    shown.sort(key=lambda pick: -pick.badness)
    return gallery_of(shown, sum(map(len, found)), tell)


def shared_out(most: int, sizes: Sequence[int]) -> list[int]:
    """How many each of several lists may show: the same, and what one does not need goes to the others."""
    shares = [0] * len(sizes)
    for _ in range(max(sizes, default=0)):
        for k, size in enumerate(sizes):
            if shares[k] < size and sum(shares) < most:
                shares[k] += 1
    return shares


def _wrong(a: Loaded, b: Loaded) -> list[list[Pick]]:
    """What only A, only B and both got wrong, each worst first; a card is that of the run whose answer is worse."""
    of_a, of_b = ({key(row): row for row in run.failures} for run in (a, b))
    both = [max(Pick(a, row, b, BOTH), Pick(b, of_b[k], a, BOTH), key=lambda pick: pick.badness)
            for k, row in of_a.items() if k in of_b]  # fmt: skip
    both.sort(key=lambda pick: -pick.badness)
    return [_alone(a, b, ONLY_A), _alone(b, a, ONLY_B), both]


def _alone(run: Loaded, other: Loaded, kind: str) -> list[Pick]:
    """What ``run`` got wrong and ``other`` did not."""
    theirs = {key(row) for row in other.failures}
    return [Pick(run, row, other, kind, _absent(other, row)) for row in run.failures if key(row) not in theirs]


def _absent(other: Loaded, row: ObjectRow) -> str:
    """Why the other run says nothing about an object; empty where it does."""
    there = other.row_of(row)
    if there is None:
        return f"{other.label} does not have it"
    return "" if there.was_asked_for else f"{other.label} was not asked for it: {there.message}"
