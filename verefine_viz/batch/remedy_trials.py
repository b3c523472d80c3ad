"""Which remedies are tried on which answers of some batches, and the batches that try them."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from msgspec import structs

from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.jobs import BatchJob
from verefine_viz.core.causes import CAUSES, Cause
from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.remedies import Remedy, SettingValue
from verefine_viz.core.settings import Session
from verefine_viz.diagnosis.signs import LOW_SCORE
from verefine_viz.diagnosis.usable_remedies import is_read
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import AT_ITS_START, WITH_ITS_DATA, changed

TOGETHER = " + "
"""Separator between the names of remedies that are tried together."""


@dataclass(frozen=True, eq=False)
class KnownAnswer:
    """An answer of a batch, and why it is to be mended."""

    run: str
    """Name of the batch's folder."""
    row: Answer
    is_bad: bool
    """Wrong or missing; without ground truth, in doubt."""
    cause: str
    """Cause of the failure; "" for a good answer, and where it is unknown."""

    @property
    def remedies(self) -> tuple[Remedy, ...]:
        """The remedies of the answer's cause, with the numbers of its finding put in."""
        known = CAUSES[Cause(self.cause)].remedies if self.cause in CAUSES else ()
        numbers = self.row.findings[0].numbers if self.row.findings else {}
        return tuple(remedy.for_finding(numbers) for remedy in known)


def _known_answers(runs: Mapping[str, BatchIndex]) -> tuple[KnownAnswer, ...]:
    """The answers of all runs that a method was asked for."""
    return tuple(_known(name, row) for name, index in runs.items() for row in index.rows if row.was_asked_for)


def _known(run: str, row: Answer) -> KnownAnswer:
    if row.can_be_right:
        is_bad = row.is_correct is not True
        return KnownAnswer(run, row, is_bad, row.cause if is_bad else "")
    doubt = _doubt(row)
    return KnownAnswer(run, row, bool(doubt), doubt)


def _doubt(row: Answer) -> str:
    """What makes an answer without ground truth doubtful; "" for nothing."""
    if row.status != "ok":
        return Cause.NO_HYPOTHESIS
    if row.cause:
        return row.cause
    if row.score is not None and row.score < LOW_SCORE:
        return Cause.POOL
    return Cause.AMBIGUOUS if row.n_alike else ""


@dataclass(frozen=True, eq=False)
class Trial:
    """A remedy, or several together, with all that it is tried on."""

    remedies: tuple[Remedy, ...]
    bad: tuple[KnownAnswer, ...]
    """The answers that the remedy is meant for."""
    good: tuple[KnownAnswer, ...]
    """All good answers of its runs, which the remedy could break."""
    jobs: Mapping[str, BatchJob]
    """A batch for each run: of the frames with bad answers, and of frames with a sample of the good ones."""

    @property
    def name(self) -> str:
        return TOGETHER.join(remedy.name for remedy in self.remedies)

    @property
    def solved(self) -> tuple[KnownAnswer, ...]:
        """All answers in the frames that are solved, the bad ones first."""
        frames = {(run, frame) for run, job in self.jobs.items() for frame in job.session.scene.frames}
        return (*self.bad, *(one for one in self.good if (one.run, one.row.frame) in frames))


def trials_of(
    runs: Mapping[str, BatchIndex], out: Path, seed: int = 0, every: bool = False, together: Sequence[str] = ()
) -> tuple[Trial, ...]:
    """What is tried: each remedy that a cause names, and those of ``together`` at once.

    Args:
        runs: batches by name.
        out: the folder of all trials.
        seed: of the sample of good answers.
        every: whether each remedy is tried on all bad answers, and where those of their causes change nothing each
            that is known; else on those of its causes.
        together: names of remedies, or of rows that have several; one alone is tried anyway.

    Raises:
        VerefineError: no remedy is known, or no session can have it.
    """
    answers = _known_answers(runs)
    bad = [one for one in answers if one.is_bad]
    good = [one for one in answers if not one.is_bad]
    sample = random.Random(seed).sample(good, len(good))
    named: dict[str, tuple[Remedy, list[KnownAnswer]]] = {}
    for one in bad:
        for remedy in one.remedies:
            named.setdefault(remedy.name, (remedy, []))[1].append(one)
    if every and not any(remedied(index.session, [of[0]]) for of in named.values() for index in runs.values()):
        every_known = (remedy.for_finding({}) for known in CAUSES.values() for remedy in known.remedies)
        named = {remedy.name: (remedy, []) for remedy in every_known if bad}
    sets = list[tuple[tuple[Remedy, ...], list[KnownAnswer]]]()
    sets += [((remedy,), bad if every else of_it) for remedy, of_it in named.values()]
    chosen = tuple(dict.fromkeys(_remedy_named(name, named) for names in together for name in names.split(TOGETHER)))
    if len(chosen) > 1:
        of_any = [one for one in bad if every or any(one in named[name][1] for name in chosen)]
        sets.append((tuple(named[name][0] for name in chosen), of_any))
    trials = (_trial(remedies, of_it, sample, runs, out) for remedies, of_it in sets)
    return tuple(trial for trial in trials if trial.jobs)


def _remedy_named(name: str, known: Mapping[str, Any]) -> str:
    """The whole name of a remedy, which may be named by its setting alone.

    Raises:
        SettingsError: there is none, or several change that setting.
    """
    meant = [one for one in known if name in (one, one.split(" ")[0])]
    if len(meant) != 1:
        raise SettingsError(unknown("remedy", name, tuple(meant or known)))
    return meant[0]


def _trial(
    remedies: tuple[Remedy, ...],
    bad: Sequence[KnownAnswer],
    sample: Sequence[KnownAnswer],
    runs: Mapping[str, BatchIndex],
    out: Path,
) -> Trial:
    sessions = {name: remedied(index.session, remedies) for name, index in runs.items()}
    mended = {name: session for name, session in sessions.items() if session is not None}
    bad = [one for one in bad if one.run in mended]
    good = [one for one in sample if one.run in mended]
    frames: dict[str, set[str]] = {}
    for one in (*bad, *good[: len(bad)]):
        frames.setdefault(one.run, set()).add(one.row.frame)
    trial = Trial(remedies, tuple(bad), tuple(good), {})
    slug = re.sub(r"[^\w.+]+", "_", trial.name)
    jobs = {}
    for run, own in frames.items():
        session, folder = mended[run], out / (slug if len(runs) == 1 else f"{run}-{slug}")
        in_order = runs[run].frames if session.method.track else own
        scene = structs.replace(session.scene, frames=tuple(sorted(in_order, key=parse_frame)))
        recording = structs.replace(session.recording, keep="none")
        jobs[run] = BatchJob(structs.replace(session, scene=scene, recording=recording), folder, folder.name)
    return replace(trial, jobs=jobs)


def remedied(session: Session, remedies: Sequence[Remedy]) -> Session | None:
    """A session with some remedies; None where they change nothing of it.

    Raises:
        SettingsError: two of them change the same setting.
    """
    changes: dict[str, dict[str, Any]] = {}
    for name, value in changes_of(session, remedies).items():
        section, _, field = name.partition(".")
        changes.setdefault(section, {})[field] = value
    return changed(session, changes, (*AT_ITS_START, *WITH_ITS_DATA, "scene")) if changes else None


def changes_of(session: Session, remedies: Sequence[Remedy]) -> dict[str, SettingValue]:
    """What some remedies change of a session, by dotted name; nothing where it has that already, or its method reads
    none of it.

    Raises:
        SettingsError: two of them change the same setting.
    """
    names = [remedy.setting for remedy in remedies]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise SettingsError(f"two remedies change {twice}; take one of them")
    changes: dict[str, SettingValue] = {}
    for remedy in remedies:
        changes |= remedy.changes(session) if is_read(remedy, session) else {}
    return changes


def jobs_of(trials: Sequence[Trial]) -> Iterator[BatchJob]:
    """All batches of some trials."""
    for trial in trials:
        yield from trial.jobs.values()


def check_trials(trials: Sequence[Trial], runs: Mapping[str, BatchIndex]) -> None:
    """
    Raises:
        InputError: there is nothing to try; the text says why.
    """
    if trials:
        return
    bad = [one for one in _known_answers(runs) if one.is_bad]
    if not bad:
        raise InputError("no answer is wrong or in doubt: there is nothing to mend")
    if not any(one.cause for one in bad):
        raise InputError(
            f"of {len(bad)} wrong answers no cause is known, so no remedy; run the batch without --no-diagnose, or try "
            "every remedy with --all"
        )
    names = ", ".join(dict.fromkeys(remedy.name for one in bad for remedy in one.remedies))
    if names:
        raise InputError(
            f"{len(bad)} wrong answers ask for {names}, which changes nothing here; try every remedy with --all"
        )
    raise InputError(f"no setting mends the causes of {len(bad)} wrong answers; docs/causes.md says what to look at")
