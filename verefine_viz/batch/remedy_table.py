"""What remedies came to: a row for each remedy and cause, and what became of each answer."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from verefine_viz.batch.fix_files import EVERY_CAUSE, FixAnswer, FixRow, FixTable
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.remedy_trials import KnownAnswer, Trial
from verefine_viz.batch.runs import Runs
from verefine_viz.core.causes import Cause
from verefine_viz.core.settings import Session
from verefine_viz.diagnosis.signs import NEAR_TIE
from verefine_viz.methods.known_methods import method_of
from verefine_viz.run.record import Answer, RunEnd
from verefine_viz.run.variants import scores_alike

STAGES = ("read", "start", "iterate")
"""What of a frame's time a remedy changes; initial poses are made when it is read."""
CLEARLY = 1.25
"""An answer that is undetermined so many times as far is less certain."""


def fix_table(
    trials: Sequence[Trial], runs: Mapping[str, BatchIndex], seed: int, every: bool, together: Sequence[str]
) -> FixTable:
    """What some trials came to, of the frames that are solved."""
    rows, answers = list[FixRow](), list[FixAnswer]()
    for trial in trials:
        ends = _Ends(trial, runs)
        tried = [one for known in trial.solved if (one := _fixed(known, trial, runs, ends)) is not None]
        rows += _rows(trial, tried, ends.seconds_added)
        answers += tried
    rows.sort(key=lambda row: (-row.net_gain, -row.net_low))
    return FixTable(seed, every, tuple(together), tuple(rows), tuple(answers))


class _Ends:
    """How frames ended before and after a remedy."""

    def __init__(self, trial: Trial, runs: Mapping[str, BatchIndex]) -> None:
        self.after: dict[tuple[str, str], RunEnd] = {}
        added: list[float] = []
        for run, job in trial.jobs.items():
            before, after = Runs(runs[run].folder / "runs"), Runs(job.folder / "runs")
            for record in after.records(job.session.scene.frames):
                frame = record.header.frame
                assert record.end is not None
                self.after[run, frame] = record.end
                old = before.read(frame)
                if old is not None and old.end is not None and not (old.end.failed or record.end.failed):
                    added.append(_seconds(record.end) - _seconds(old.end))
        self.seconds_added = sum(added) / len(added) if added else None


def _seconds(end: RunEnd) -> float:
    return 1e-3 * sum(end.stages_ms.get(stage, 0.0) for stage in STAGES)


def _fixed(known: KnownAnswer, trial: Trial, runs: Mapping[str, BatchIndex], ends: _Ends) -> FixAnswer | None:
    """What became of an answer; None where its frame is not solved yet."""
    row, job = known.row, trial.jobs[known.run]
    end = ends.after.get((known.run, row.frame))
    if end is None:
        return None
    now = next((one for one in end.answers if one.instance_id == row.instance_id and one.was_asked_for), None)
    if row.can_be_right:
        change = int(now is not None and now.is_correct is True) - int(row.is_correct is True)
    else:
        change = fits_better(row, now, runs[known.run].session, job.session)
    return FixAnswer(
        remedy=trial.name,
        cause=known.cause,
        run=known.run,
        folder=job.folder.name,
        frame=row.frame,
        instance_id=row.instance_id,
        name=row.name,
        by_truth=row.can_be_right,
        was_bad=known.is_bad,
        change=change,
        errors_mm=(row.add_s_mm, None if now is None else now.add_s_mm),
        scores=(row.score, None if now is None else now.score),
    )


def fits_better(before: Answer, after: Answer | None, one: Session, other: Session) -> int:
    """Whether an answer without ground truth fits better (1) or worse (-1) than before, by the first that differs: an
    answer at all, physics, score, poses that fit as well, how far it is undetermined.

    Physics is compared where both sessions ask it, scores where both score by the same rule.
    """
    had, has = before.status == "ok", after is not None and after.status == "ok"
    if after is None or not (had and has):
        return int(has) - int(had)
    asked = all(s.physics.enabled and method_of(s.method.name).simulates for s in (one, other))
    possible = (before.cause != Cause.IMPOSSIBLE, after.cause != Cause.IMPOSSIBLE)
    if asked and possible[0] != possible[1]:
        return int(possible[1]) - int(possible[0])
    if before.score is not None and after.score is not None and scores_alike(one, other):
        lead = after.score - before.score
        if abs(lead) >= NEAR_TIE:
            return int(math.copysign(1, lead))
    if bool(before.n_alike) != bool(after.n_alike):
        return int(bool(before.n_alike)) - int(bool(after.n_alike))
    widths = ((before.undetermined_mm, after.undetermined_mm), (before.undetermined_deg, after.undetermined_deg))
    clear = [
        int(was > is_) - int(is_ > was)
        for was, is_ in widths
        if was is not None and is_ is not None and max(was, is_) > CLEARLY * min(was, is_)
    ]
    return int(math.copysign(1, sum(clear))) if sum(clear) else 0


def _rows(trial: Trial, answers: Sequence[FixAnswer], seconds_added: float | None) -> list[FixRow]:
    rows = list[FixRow]()
    for by_truth in (True, False):
        mine = [one for one in answers if one.by_truth == by_truth]
        bad = [one for one in mine if one.was_bad]
        n_known = sum(one.row.can_be_right == by_truth for one in trial.good)
        causes = list(dict.fromkeys(one.cause for one in bad))
        of_cause = {cause: [one for one in bad if one.cause == cause] for cause in causes}
        if len(causes) > 1:
            of_cause[EVERY_CAUSE] = bad
        good = [one for one in mine if not one.was_bad]
        rows += [
            _row(trial.name, cause, by_truth, of_it, good, n_known, seconds_added) for cause, of_it in of_cause.items()
        ]
    return rows


def _row(
    remedy: str,
    cause: str,
    by_truth: bool,
    bad: Sequence[FixAnswer],
    good: Sequence[FixAnswer],
    n_known: int,
    seconds_added: float | None,
) -> FixRow:
    came_right, worse = (sum(one.change == change for one in bad) for change in (1, -1))
    broke = sum(one.change == -1 for one in good)
    shares = [(1, came_right, len(bad), len(bad)), (-1, broke, len(good), n_known)]
    net, low, high = net_gain(shares if by_truth else [*shares, (-1, worse, len(bad), len(bad))])
    return FixRow(
        remedy=remedy,
        cause=cause,
        judged_by="ground truth" if by_truth else "fit",
        tried=len(bad),
        came_right=came_right,
        worse=worse,
        right_tried=len(good),
        broke=broke,
        right_known=n_known,
        net_gain=net,
        net_low=low,
        net_high=high,
        seconds_added=seconds_added,
    )


def net_gain(shares: Iterable[tuple[int, int, int, int]]) -> tuple[float, float, float]:
    """A sum of shares, each of so many, with its 95 % interval: Wilson's of each share, as Newcombe adds them.

    Args:
        shares: 1 of a gain or -1 of a loss; how many of those tried it is; how many were tried; how many there are.
            Where none was tried, nothing is known and nothing added.
    """
    net, below, above = 0.0, 0.0, 0.0
    for sign, k, n, n_all in shares:
        if not n:
            continue
        share, (low, high) = k / n, wilson(k, n)
        less, more = (n_all * (share - low)) ** 2, (n_all * (high - share)) ** 2
        net += sign * n_all * share
        below += less if sign > 0 else more
        above += more if sign > 0 else less
    return net, net - math.sqrt(below), net + math.sqrt(above)


def wilson(k: int, n: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson's 95 % interval of a share of ``k`` in ``n`` > 0."""
    share, w = k / n, z * z / n
    half = z * math.sqrt(share * (1 - share) / n + w / (4 * n))
    middle = share + w / 2
    return max(0.0, (middle - half) / (1 + w)), min(1.0, (middle + half) / (1 + w))
