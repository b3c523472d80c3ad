"""The report as data: message ``report`` (docs/page.md), which ``page/web/report.js`` draws."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, get_args

import numpy as np

from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.motion_table import MotionTrack, read_tracks
from verefine_viz.batch.totals import describe_doubts
from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.bootstrap import Spread
from verefine_viz.grasping.grasp_verdict import Verdict
from verefine_viz.page.gallery import Gallery
from verefine_viz.page.gallery_messages import (
    Interval,
    NextStep,
    RecallCurve,
    ReportColumn,
    ReportGroup,
    ReportMessage,
    ReportSection,
    ReportTrack,
    TrackMove,
)
from verefine_viz.report import report_words as words
from verefine_viz.report.group_numbers import (
    COLUMNS,
    MOST_HARD,
    THRESHOLDS,
    GroupColumn,
    GroupLine,
    cause_counts,
    compare,
    hardest,
    object_numbers,
    score_misleads,
    stage_times,
)
from verefine_viz.report.groups import Group, Section, differing
from verefine_viz.report.pair_difference import apart, difference
from verefine_viz.run.session_file import session_toml

if TYPE_CHECKING:
    from verefine_viz.report.bop_recalls import BopRecalls

StepProgress = Callable[[str, int, int], None]
"""Called with what is being done, how many parts of it are done, and how many there are."""
RecallsOf = Callable[[Sequence[BatchIndex], Callable[[int, int], None]], "BopRecalls"]
"""Works out the BOP scores of runs on the same data; called with how many frames are done, of how many."""
MOST_TRACKS = 10
"""Objects of a sequence that are drawn, those that flip and jump most."""


def report_message(
    sections: Sequence[Section],
    gallery: Gallery,
    left_out: Sequence[tuple[str, str]],
    recalls_of: RecallsOf,
    progress: StepProgress = lambda what, done, of: None,
) -> ReportMessage:
    """Return all that a report shows beside its gallery.

    Args:
        sections: at least one.
        gallery: of the same runs; answers are named by their keys in it.
        left_out: runs that cannot be used, and why.
        recalls_of: works out the BOP scores of runs.
        progress: what is being done.
    """
    keys = {id(entry.row): key for key, entry in enumerate(gallery.entries)}
    runs = [run for section in sections for run in section.runs]
    titles = {run.session.title for run in runs}
    parts = list[ReportSection]()
    for section in sections:
        bop = recalls_of(section.runs, lambda done, of: progress("BOP scores", done, of))
        parts.append(_section(section, bop, keys, {id(run): name for name, run in gallery.runs.items()}))
    return ReportMessage(
        title=words.title(sections),
        session_title=titles.pop() if len(titles) == 1 else "",
        counted=words.counted(sections),
        notes=list(dict.fromkeys(note for run in runs for note in run.notes)),
        left_out=left_out,
        columns=[_column(column) for column in COLUMNS],
        thresholds=_rounded(100 * THRESHOLDS, 1),
        sections=parts,
    )


def _section(section: Section, bop: BopRecalls, keys: Mapping[int, int], names: Mapping[int, str]) -> ReportSection:
    comparison = compare(section, bop)
    step, pair, hard = words.next_step(comparison.best.group), section.pair, hardest(section, keys)
    titles = {run.session.title for run in section.runs}
    n_groups = len(section.groups)
    tracks = [(names[id(run)], track) for run in section.runs for track in read_tracks(run.folder)]
    tracks.sort(key=lambda one: -(one[1].counts.flips + one[1].counts.jumps))
    best = section.groups.index(comparison.best.group)
    return ReportSection(
        data=section.data,
        session_title=titles.pop() if len(titles) == 1 else "",
        n_frames=len(section.frames),
        headline=words.headline(comparison),
        next=None
        if step is None
        else NextStep(best, step.text, keys[id(step.begin)], f"{step.begin.name} in frame {step.begin.frame}"),
        doubt=describe_doubts([(names[id(run)], run.rows) for run in section.runs]),
        has_truth=comparison.has_truth,
        same_objects=section.has_same_objects,
        bop=bop.note,
        intervals=words.explanation(comparison),
        best=best,
        groups=[_group(line, names) for line in comparison.lines],
        objects=object_numbers(comparison),
        hardest=hard[:MOST_HARD] if n_groups > 1 and not pair else (),
        n_hard=len(hard),
        differing=[*differing([g.session for g in section.groups]).items()],
        change=None if pair is None or not comparison.has_truth else difference(*pair, keys),
        apart=() if pair is None or comparison.has_truth else apart(*pair, keys),
        tracks=[_track(run, track, k < MOST_TRACKS) for k, (run, track) in enumerate(tracks)],
    )


def _group(line: GroupLine, names: Mapping[int, str]) -> ReportGroup:
    group = line.group
    return ReportGroup(
        name=group.name,
        runs=[names[id(run)] for run in group.runs],
        n_objects=len(group.objects),
        n_with_truth=len(group.with_truth),
        numbers={
            column.id: _spread(line.numbers[column.id], column.factor, column.digits)
            for column in COLUMNS
            if column.id in line.numbers
        },
        behind=None if line.behind is None else _spread(line.behind, 100, 1),
        curve=_curve(line),
        causes=[(title or "not explained", n) for title, n in cause_counts(group).most_common()],
        misleads=score_misleads(group),
        stages={name: round(ms, 2) for name, ms in stage_times(group).items()},
        grasps=_grasps(group),
        made=_made(group.runs),
        session=session_toml(group.session),
    )


def _curve(line: GroupLine) -> RecallCurve | None:
    if line.curve is None:
        return None
    recall, band = line.curve
    low, high = (None, None) if band is None else (_rounded(100 * end, 2) for end in band)
    return RecallCurve(_rounded(100 * recall, 2), low, high)


def _grasps(group: Group) -> list[tuple[str, int, int]]:
    """How the simulated grasps by answers end, and those by ground truth: [end, answers, ground truth]."""
    tried = [row for row in group.objects if row.grasp]
    answers, truth = Counter(row.grasp for row in tried), Counter(row.grasp_ground_truth for row in tried)
    return [(end, answers[end], truth[end]) for end in get_args(Verdict) if answers[end] or truth[end]]


def _track(run: str, track: MotionTrack, is_drawn: bool) -> ReportTrack:
    counts = track.counts
    moved = [
        TrackMove(row.im_id, round(row.moved_mm, 2), round(row.turned_deg, 1), row.kind)
        for row in track.rows
        if row.kind != "no pose"
    ]
    return ReportTrack(
        run=run,
        name=track.name,
        scene=track.scene_id,
        frames=counts.n_frames,
        flips=counts.flips,
        per_100=round(counts.flips_per_100, 2),
        jumps=counts.jumps,
        no_pose=counts.no_pose,
        mm=counts.median_mm,
        deg=counts.median_deg,
        drift_mm=counts.drift_mm,
        moved=moved if is_drawn else (),
    )


def _made(runs: Sequence[BatchIndex]) -> list[str]:
    """How the first of some runs was made: version, when, how long, by what."""
    info = runs[0].run
    known = {
        f"verefine-viz {info.version}": info.version,
        info.status: info.status,
        f"begun {info.begun}": info.begun,
        f"{info.seconds:.0f} s": info.seconds,
        str(info.machine.get("cpu")): "cpu" in info.machine,
        f"{info.workers} worker{'s' * (info.workers != 1)}": info.workers,
    }
    return [words for words, is_known in known.items() if is_known]


def _column(column: GroupColumn) -> ReportColumn:
    return ReportColumn(column.id, column.label, column.hint, column.unit, column.digits, column.better)


def _spread(spread: Spread, factor: float, digits: int) -> Interval:
    """(value, low, high); low and high are None where nothing could be drawn."""

    def rounded(end: float | None) -> float | None:
        return None if end is None else round(factor * float(end), digits + 2) + 0.0

    return rounded(spread.value), rounded(spread.low), rounded(spread.high)


def _rounded(values: Float, digits: int) -> list[float]:
    """As few digits as a chart shows: the file stays small."""
    return np.round(values, digits).tolist()
