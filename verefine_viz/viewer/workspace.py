"""What is open: a session, its frames, and on each frame its runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.breakpoint_settings import BreakpointSettings
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.listing import first_of
from verefine_viz.core.patience import ENDLESS, Patience
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Change, Session
from verefine_viz.scenes.estimates import asked_estimators
from verefine_viz.session.engine import Run
from verefine_viz.session.files import changed
from verefine_viz.viewer.all_frames import edits_of_all
from verefine_viz.viewer.branch import Branch, FrameWork
from verefine_viz.viewer.changes import in_order, merged, nested
from verefine_viz.viewer.command import Changes
from verefine_viz.viewer.judge import Judge
from verefine_viz.viewer.saved import Saved
from verefine_viz.viewer.tools import Tools

if TYPE_CHECKING:
    from verefine_viz.recording.reader import Recorded


class Workspace:
    """The open session. Opening builds everything first and then switches, so a failure leaves things as they were.

    So does whoever has no patience left: ``core.errors.Cancelled`` is raised before anything was switched.

    Args:
        session: what to open first.
        path: its file, if it has one.
        make_tools: builds the real or fake parts from a session.
        plausibility: see :class:`Judge`.
        patience: asked before anything that may take seconds.
        overlap: see :class:`Judge`.
    """

    def __init__(
        self,
        session: Session,
        path: Path | None,
        make_tools: Callable[[Session], Tools],
        plausibility: Callable[..., Any] | None = None,
        patience: Patience = ENDLESS,
        overlap: Callable[..., Any] | None = None,
    ) -> None:
        self._make_tools = make_tools
        self._patience = patience
        self._plausibility, self._overlap = plausibility, overlap
        self.open(session, path)

    def open(self, session: Session, path: Path | None, frame: str | None = None) -> None:
        """Another session, at its first frame or the one named."""
        self._patience.ask("Reading the scene: models, pictures, first poses.")
        tools = self._make_tools(session)
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

    @property
    def work(self) -> FrameWork:
        return self._works[self.frame]

    @property
    def branch(self) -> Branch:
        return self.work.branch

    def is_open(self, branch: Branch) -> bool:
        """Whether it can still be looked at, on whatever frame."""
        return any(branch is other for work in self._works.values() for other in work.branches)

    @property
    def others(self) -> tuple[Branch, ...]:
        """The open branches of the other frames that were looked at."""
        return tuple(work.branch for frame, work in self._works.items() if frame != self.frame)

    @property
    def has_other_frames(self) -> bool:
        """Whether frames beside the shown one were looked at, and are as they were left."""
        return len(self._works) > 1

    @property
    def run(self) -> Run:
        return self.branch.run

    @property
    def session(self) -> Session:
        """What a session file has to say to repeat the run that is open, with the poses moved in other frames."""
        branch, edits = self.branch, edits_of_all(self.branch, self.others, is_only_frame=len(self.frames) == 1)
        return branch.start.model_copy(
            update={"edits": edits, "changes": branch.changes, "breakpoints": self.breakpoints}
        )

    def restart(self, changes: Changes) -> None:
        """Back to before iteration 1, with the settings that the open branch ends up with, changed if any.

        Other branches, poses moved by hand and settings changed on the way go. New first poses (``hypotheses.*``) open
        the session anew.
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
        work = self._begin(tools, problem)
        if tools is not self.tools:  # The other frames were run with other settings.
            self._works = {}
        self.tools, self._works[self.frame] = tools, work

    def estimate(self, instance_id: int, estimator: str, name: str) -> None:
        """A new branch of the open frame, from before iteration 1: an estimator finds the first poses of one object, or
        it has those of the session again ("session").

        The frame's other branches stay; other frames begin anew, with the first poses that they had.
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
        if old.recording is not None and (cursor or edit is not None):
            raise InputError(
                f"{old.name} was read from a file and cannot be continued; fork it at iteration 0, "
                "or press Restart to run its session here"
            )
        # A session that was read begins with other settings than it ends up with.
        tools = old.tools.changed(merged((*(c.settings for c in old.changes), nested(changes))))
        if tools.session == old.tools.session:
            tools = old.tools
        kept = tuple(c for c in old.changes if c.after_iteration <= cursor)
        later = [c.settings for c in old.changes if c.after_iteration > cursor]
        new = merged((*later, nested(changes)))
        if new:
            kept = (*kept, Change(after_iteration=cursor, settings=new))
        run = old.run.fork(cursor, tools.method if new else None, edit)
        judges = tuple((k, judge) for k, judge in old.judges if k < cursor or k == 0)
        if "score" in new:
            judges = (*(judges if cursor else ()), (cursor, self._judge(tools)))
        name = _name(cursor, changes, edit)
        self.work.branches.append(Branch(name, run, tools, old.start, kept, judges))
        self.work.index = len(self.work.branches) - 1

    def open_recording(self, path: Path) -> None:
        """A recording as the open run, on its frame."""
        from verefine_viz.recording.reader import read_recording

        recorded = read_recording(path)
        self._patience.ask("Reading the scene: models, pictures, first poses.")
        scene = recorded.session.scene.model_copy(update={"frames": (recorded.frame,)})
        session = recorded.session.model_copy(update={"scene": scene})
        tools = self._make_tools(session)
        branch = self.recorded_branch(recorded, tools, _read(tools, recorded.frame))
        self.tools, self.path, self.frames = tools, None, (recorded.frame,)
        self.files = {}
        self.breakpoints = session.breakpoints
        self.frame, self._works = recorded.frame, {recorded.frame: FrameWork([branch])}

    def recorded_branch(self, recorded: Recorded, tools: Tools, problem: Problem) -> Branch:
        """A recording as a branch."""
        # Rerun takes a second to load, and most sessions never read a recording.
        from verefine_viz.recording.playback import played

        run, path, session = played(recorded, problem), recorded.path, tools.session
        return Branch(path.name, run, tools, session, session.changes, self._judges(tools), path)

    def tools_of(self, session: Session) -> Tools:
        """What runs a session's method."""
        return self._make_tools(session)

    def new_branch(self, name: str, tools: Tools, problem: Problem) -> Branch:
        """A run of ``problem`` from its start, not yet among the branches."""
        self._patience.ask(preparing(problem, tools.session))
        return Branch(name, tools.run(problem), tools, tools.session, tools.session.changes, self._judges(tools))

    def _begin(self, tools: Tools, problem: Problem) -> FrameWork:
        if not problem.instances:
            raise InputError(f"frame {problem.frame} holds none of the objects asked for; choose another frame")
        return FrameWork([self.new_branch("first run", tools, problem)])

    def _judges(self, tools: Tools) -> tuple[tuple[int, Judge], ...]:
        """Those of a run from its start, with the changes that its session holds."""
        found = [(0, self._judge(tools))]
        for change in in_order(tools.session.changes):
            tools = tools.changed(change.settings)
            if "score" in change.settings:
                found.append((change.after_iteration, self._judge(tools)))
        return tuple(found)

    def _judge(self, tools: Tools) -> Judge:
        return Judge(tools, self._plausibility, self._overlap)


def _read(tools: Tools, frame: str) -> Problem:
    """A frame, and whether its camera and its models look right; a batch has no time to look."""
    from verefine_viz.calibration.camera_check import camera_notes  # Loads what draws models.

    problem = tools.problem(frame)
    return replace(problem, doubts=camera_notes(problem))


def preparing(problem: Problem, session: Session) -> str:
    """What is done before iteration 1, in words."""
    shown = first_of(sorted({problem.models[i.obj_id].name for i in problem.instances}), 4)
    parts = "convex parts for physics and " if session.physics.enabled else ""
    return f"Preparing: {parts}meshes to score of {shown}. Up to half a minute for a new model, else a second."


def _name(cursor: int, changes: Changes, edit: tuple[int, int, Float] | None) -> str:
    what = ", ".join(f"{name.rpartition('.')[2]} = {value}" for name, value in changes)
    if edit is not None:
        what = ", ".join(filter(None, (what, f"hypothesis {edit[1] + 1} moved by hand")))
    return f"{what or 'same settings'}, from iteration {cursor}"
