"""What is open: a session, its frames, on each frame its runs, and the files that hold the session."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from verefine_viz.core.algorithm_settings import BreakpointSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import SURROUNDINGS, Change, Edit, Session
from verefine_viz.core.text_format import first_of, listed
from verefine_viz.run.edits import edits_of
from verefine_viz.run.engine import Run
from verefine_viz.run.record import RunRecord, session_of
from verefine_viz.run.session_file import changed
from verefine_viz.run.track import with_its_tracked
from verefine_viz.scenes.hypothesis_pool import asked_estimators
from verefine_viz.viewer.commands import Changes
from verefine_viz.viewer.state.branch import Branch, FrameWork, in_order, merged, nested
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox


# What files hold of the open session.


@dataclass(frozen=True, eq=False)
class Saved:
    """The open session as a file has it."""

    session: Session
    branch: Branch | None = None
    """Which it was written of; None = the session was read from there."""

    @property
    def repeats(self) -> bool:
        """Whether a run of it moves poses or changes settings on the way."""
        return bool(self.session.edits or self.session.changes)


@dataclass(frozen=True)
class WrittenFile:
    """A file that was written at the user's command."""

    path: Path
    note: str = ""
    """What else became of it; "" = nothing."""

    @property
    def words(self) -> str:
        """Where it is."""
        return f"{self.path}; {self.note}" if self.note else str(self.path)


# What was done in all frames of a session, as one session file can say it.


def edits_of_all(shown: Branch, others: Sequence[Branch], is_only_frame: bool) -> tuple[Edit, ...]:
    """The poses moved in all frames: as the open runs of those that were opened have them, else as the session has.

    Those of the shown frame come first: a session opens at the first frame in which it moves a pose.

    Args:
        shown: the open branch.
        others: those of the other frames that were opened.
        is_only_frame: whether the session has no frame but the shown one.
    """
    made = [*_at_first(shown, is_only_frame), *(edit for other in others for edit in _at_first(other) if edit.frame)]
    elsewhere = (edit for edit in shown.start.edits if edit not in made)
    there = (edit for other in others for edit in _edits(other) if edit.frame)
    return (*_edits(shown, is_only_frame), *elsewhere, *there)


def savable(session: Session, shown: Branch, others: Sequence[Branch], n_frames: int) -> tuple[Session, str]:
    """What is written to a file, and what it does not hold, in words; "" = it holds all.

    Settings changed on the way hold in every frame of a session, so those that were changed in one are saved with that
    frame alone.

    Args:
        session: what repeats the open branch, with the poses moved in all frames.
        shown: the open branch.
        others: those of the other frames that were opened.
        n_frames: how many the session has.
    """
    frame, apart = shown.run.problem.frame, [o.run.problem.frame for o in others if not _goes_with(o, shown)]
    if n_frames > 1 and _goes_with(shown, shown):
        first = tuple(edit for edit in shown.start.edits if edit.frame in apart)
        edits = (*(edit for edit in session.edits if edit.frame not in apart), *first)
        return session.model_copy(update={"edits": edits}), _lacks(apart)
    here = edits_of(session.edits, shown.run.problem, is_only_frame=n_frames == 1)
    if n_frames == 1 and not here and not session.changes:
        return session, ""
    scene = session.scene.model_copy(update={"frames": (frame,)})
    apart += [edit.frame for edit in session.edits if edit.frame not in ("", frame)]
    alone = session.model_copy(update={"scene": scene, "edits": here})
    if n_frames == 1:
        return alone, ""
    belongs = beside_the_method(alone) or "a pose that the session moves in every frame is not moved here, which"
    opens = f"it opens frame {frame} alone: {belongs} belong{'' if beside_the_method(alone) else 's'} to it"
    return alone, "; ".join(filter(None, (opens, _lacks(apart))))


def beside_the_method(session: Session) -> str:
    """What a run of a session does beside its method, in words."""
    moved, changed = bool(session.edits) * ["edited poses"], bool(session.changes) * ["settings changed later"]
    return " and ".join(moved + changed)


def _lacks(frames: Sequence[str]) -> str:
    names = sorted(set(frames))
    if not names:
        return ""
    return f"it does not hold what was done in frame{'s' if len(names) > 1 else ''} {listed(names)}: save that there"


def _goes_with(branch: Branch, shown: Branch) -> bool:
    """Whether one session can say what was done in a branch and in the shown one: poses of named frames were moved."""
    start, other = (b.start.model_copy(update={"edits": (), "tracked": ()}) for b in (branch, shown))
    dropped = any(not edit.frame and edit not in _edits(branch) for edit in _at_first(branch))
    return start == other and branch.changes == branch.start.changes and not dropped


def _edits(branch: Branch, is_only_frame: bool = False) -> tuple[Edit, ...]:
    """The poses that a branch moves; one that was read moves none again."""
    return _at_first(branch, is_only_frame) if branch.recording else branch.run.edits


def _at_first(branch: Branch, is_only_frame: bool = False) -> tuple[Edit, ...]:
    """Those that the session moves in the branch's frame, as it was opened."""
    return edits_of(branch.start.edits, branch.run.problem, is_only_frame)


HULLS = {"physics": {"collider": "hull"}}
"""Settings with which no model has to be decomposed."""


class Workspace:
    """The open session. Opening builds everything first and then switches, so a failure leaves things as they were.

    So does cancelling: ``core.errors.Cancelled`` is raised before anything was switched.

    Args:
        session: what to open first.
        path: its file, if it has one.
        make_tools: builds the algorithm's parts from a session.
        plausibility: see :class:`CachedEvaluator`.
        progress: checked before anything that may take seconds.
        overlap: see :class:`CachedEvaluator`.
        frame: what to open first of it; None = its first.
    """

    def __init__(
        self,
        session: Session,
        path: Path | None,
        make_tools: Callable[[Session], Toolbox],
        plausibility: Callable[..., Any] | None = None,
        progress: ProgressToken = NEVER_CANCELLED,
        overlap: Callable[..., Any] | None = None,
        frame: str | None = None,
    ) -> None:
        self.make_tools = make_tools
        self._progress = progress
        self._plausibility, self._overlap = plausibility, overlap
        self.open(session, path, frame)

    def open(self, session: Session, path: Path | None, frame: str | None = None) -> None:
        """Another session, at its first frame or the one named."""
        self._progress.checkpoint("Reading the scene: models, pictures, initial poses.")
        tools = self.make_tools(session)
        frames = tools.frames
        if not frames:
            raise InputError("the session names no frame; give scene.frames, or a data set with images")
        first = frame if frame is not None else next((e.frame for e in session.edits if e.frame in frames), frames[0])
        work = self._begin(tools, _read(tools, first))
        self.tools, self.path, self.frames = tools, path, frames
        self.files: dict[Path, Saved] = {} if path is None else {path.resolve(): Saved(session)}
        """Files that hold the open session, as it was when it was read or written, the latest last."""
        self.breakpoints: BreakpointSettings = session.breakpoints
        self.frame, self._works = first, {first: work}

    def open_frame(self, frame: str) -> None:
        """Another frame; one that was open before is as it was left."""
        if frame not in self.frames:
            raise InputError(unknown("frame", frame, self.frames))
        if frame not in self._works:
            self._works[frame] = self._begin(self.tools, _read(self.tools, frame))
        self.frame = frame

    @contextmanager
    def with_hulls(self) -> Iterator[None]:
        """What is opened inside has ``physics.collider = "hull"``; frames that are open stay as they are."""
        tools, make_tools = self.tools, self.make_tools
        self.tools, self.make_tools = tools.changed(HULLS), lambda session: make_tools(changed(session, HULLS))
        try:
            yield
        except BaseException:
            self.tools = tools
            raise
        finally:
            self.make_tools = make_tools

    @property
    def work(self) -> FrameWork:
        return self._works[self.frame]

    @property
    def branch(self) -> Branch:
        return self.work.branch

    def is_open(self, branch: Branch) -> bool:
        """Whether it can still be shown, on whatever frame."""
        return any(branch is other for work in self._works.values() for other in work.branches)

    @property
    def others(self) -> tuple[Branch, ...]:
        """The open branches of the other frames that were opened."""
        return tuple(work.branch for frame, work in self._works.items() if frame != self.frame)

    @property
    def run(self) -> Run:
        return self.branch.run

    def final_scores(self, obj_id: int) -> dict[str, float]:
        """By frame the score of the answer for an object, where a run was finished; of several the first."""
        scores: dict[str, float] = {}
        for frame, work in self._works.items():
            run = work.branch.run
            if run.is_done and run.cursor == run.length:
                for target, best in zip(run.problem.targets, run.state.best, strict=True):
                    if best is not None and target.instance.obj_id == obj_id:
                        scores.setdefault(frame, best.score.score)
        return scores

    @property
    def session(self) -> Session:
        """What a session file has to say to repeat the run that is open, with the poses moved in other frames."""
        branch, edits = self.branch, edits_of_all(self.branch, self.others, is_only_frame=len(self.frames) == 1)
        return branch.start.model_copy(
            update={"edits": edits, "changes": branch.changes, "breakpoints": self.breakpoints}
        )

    def restart(self, changes: Changes) -> None:
        """Back to before iteration 1, with the settings that the open branch ends up with, changed if any.

        Other branches, edited poses and settings changed on the way are discarded. New initial poses
        (``hypotheses.*``) open the session again.
        """
        old, ended = self.branch.tools, [change.settings for change in in_order(self.branch.changes)]
        pool = nested(changes).pop("hypotheses", None)
        if pool:
            rest = tuple(change for change in changes if not change[0].startswith("hypotheses."))
            tools = old.restarted(merged((*ended, nested(rest))))
            session = changed(tools.session, {"hypotheses": pool}, ("hypotheses",))
            files = self.files
            self.open(session.model_copy(update={"breakpoints": self.breakpoints}), self.path, self.frame)
            self.files = files
            return
        same = not changes and not old.session.edits and not old.session.changes
        tools = old if same else old.restarted(merged((*ended, nested(changes))))
        problem = tools.ordered(self.work.problem) if "dependency" in nested(changes) else self.work.problem
        if any(name in SURROUNDINGS for name in nested(changes).get("physics", ())):
            problem = tools.surrounded(problem)
        work = self._begin(tools, problem)
        if tools is not self.tools:  # The other frames were run with other settings.
            self._works = {}
        self.tools, self._works[self.frame] = tools, work

    def estimate(self, instance_id: int, estimator: str, name: str) -> None:
        """A new branch of the open frame, from before iteration 1: an estimator gives the initial poses of one object,
        or it has those of the session again ("session").

        The frame's other branches stay; other frames start again, with the initial poses that they had.
        """
        before = self.work
        wanted = asked_estimators(self.branch.tools.session.hypotheses)
        wanted.pop((self.frame, instance_id), None)
        if estimator != "session":
            wanted[self.frame, instance_id] = estimator
        self.restart((("hypotheses.estimate", tuple((*key, by) for key, by in sorted(wanted.items()))),))
        self.branch.name = name
        self._works[self.frame] = FrameWork([*before.branches, self.branch], len(before.branches))

    def fork(self, cursor: int, changes: Changes, edit: tuple[int, int, Float] | None = None) -> None:
        """A new branch that leaves the open one after iteration ``cursor``.

        It goes on with the settings that the open branch ended up with, and ``changes``.
        """
        old = self.branch
        # A session that was read begins with other settings than it ends up with.
        tools = old.tools.changed(merged((*(c.settings for c in old.changes), nested(changes))))
        if tools.session == old.tools.session:
            tools = old.tools
        on_the_way = tuple(c for c in old.changes if c.after_iteration <= cursor)
        later = [c.settings for c in old.changes if c.after_iteration > cursor]
        new = merged((*later, nested(changes)))
        if new:
            on_the_way = (*on_the_way, Change(after_iteration=cursor, settings=new))
        run = old.run.fork(cursor, tools.method if new else None, edit)
        evaluators = tuple((k, evaluator) for k, evaluator in old.evaluators if k < cursor or k == 0)
        if "score" in new:
            evaluators = (*(evaluators if cursor else ()), (cursor, self._evaluator(tools)))
        name = _name(cursor, changes, edit)
        self.work.branches.append(Branch(name, run, tools, old.start, on_the_way, evaluators))
        self.work.index = len(self.work.branches) - 1

    def open_recording(self, path: Path) -> None:
        """A recording as the open run, on its frame."""
        from verefine_viz.recording.reader import read_recording

        record = read_recording(path)
        self._progress.checkpoint("Reading the scene: models, pictures, initial poses.")
        session, frame = session_of(record.header), record.header.frame
        session = session.model_copy(update={"scene": session.scene.model_copy(update={"frames": (frame,)})})
        tools = self.make_tools(session)
        branch = self.recorded_branch(path, record, tools, _read(tools, frame))
        self.tools, self.path, self.frames, self.files = tools, None, (frame,), {}
        self.breakpoints = session.breakpoints
        self.frame, self._works = frame, {frame: FrameWork([branch])}

    def recorded_branch(self, path: Path, record: RunRecord, tools: Toolbox, problem: Problem) -> Branch:
        """A recording as a branch."""
        ids = [one.instance_id for one in record.header.objects]
        run = Run.from_record(record, problem, again=lambda: tools.run(problem.only(ids)))
        changes, evaluators = tools.session.changes, self._evaluators(tools)
        return Branch(path.name, run, tools, tools.session, changes, evaluators, path, record.missing)

    def new_branch(self, name: str, tools: Toolbox, problem: Problem) -> Branch:
        """A run of ``problem`` from its start, not yet among the branches."""
        self._progress.checkpoint(_preparing(problem, tools.session))
        start = with_its_tracked(tools.session, problem)
        return Branch(name, tools.run(problem), tools, start, tools.session.changes, self._evaluators(tools))

    def _begin(self, tools: Toolbox, problem: Problem) -> FrameWork:
        if not problem.instances:
            raise InputError(f"frame {problem.frame} holds none of the objects asked for; choose another frame")
        return FrameWork([self.new_branch("first run", tools, problem)])

    def _evaluators(self, tools: Toolbox) -> tuple[tuple[int, CachedEvaluator], ...]:
        """Those of a run from its start, with the changes that its session holds."""
        evaluators = [(0, self._evaluator(tools))]
        for change in in_order(tools.session.changes):
            tools = tools.changed(change.settings)
            if "score" in change.settings:
                evaluators.append((change.after_iteration, self._evaluator(tools)))
        return tuple(evaluators)

    def _evaluator(self, tools: Toolbox) -> CachedEvaluator:
        return CachedEvaluator(tools, self._plausibility, self._overlap)


def _read(tools: Toolbox, frame: str) -> Problem:
    """A frame, and whether its camera and its models look right; a batch has no time to look."""
    from verefine_viz.calibration.camera_check import camera_notes  # Loads what draws models.

    problem = tools.problem(frame)
    return replace(problem, doubts=camera_notes(problem))


def _preparing(problem: Problem, session: Session) -> str:
    """What is done before iteration 1, in words."""
    shown = first_of(sorted({problem.models[i.obj_id].name for i in problem.instances}), 4)
    parts = "convex parts for physics and " if session.physics.enabled else ""
    return f"Preparing: {parts}meshes to score of {shown}. Up to half a minute for a new model, else a second."


def _name(cursor: int, changes: Changes, edit: tuple[int, int, Float] | None) -> str:
    what = ", ".join(f"{name.rpartition('.')[2]} = {value}" for name, value in changes)
    if edit is not None:
        what = ", ".join(filter(None, (what, f"hypothesis {edit[1] + 1} edited")))
    return f"{what or 'same settings'}, from iteration {cursor}"
