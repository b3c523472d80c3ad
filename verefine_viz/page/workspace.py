"""What is open: a session, its frames, and on each frame its branches."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import structs

from verefine_viz.core.algorithm_settings import BreakpointSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.records import Best
from verefine_viz.core.settings import LABELLED, SURROUNDINGS, Change, Session
from verefine_viz.core.text_format import first_of
from verefine_viz.methods.known_methods import method_of
from verefine_viz.page.branch import Branch, Settings, group_by_section, merged
from verefine_viz.page.data_check import DataCheck
from verefine_viz.page.evaluator import CachedEvaluator
from verefine_viz.page.grasp_trials import GraspTrials
from verefine_viz.page.saved_session import Saved, edits_of_all
from verefine_viz.run.record import RunRecord
from verefine_viz.run.record_data import recorded_problem, recorded_run, session_on_its_frame
from verefine_viz.run.run_file import read_run_file
from verefine_viz.run.run_header import session_of
from verefine_viz.run.session_file import WITH_ITS_DATA, changed
from verefine_viz.run.start_poses import starts_after, with_starts
from verefine_viz.run.track import with_its_tracked
from verefine_viz.run.variants import settings_between, sorted_changes, variant
from verefine_viz.scenes.hypothesis_pool import asked_estimators
from verefine_viz.scenes.recorded_source import RecordedPose, RecordedSource

if TYPE_CHECKING:
    from verefine_viz.batch.index import BatchIndex
    from verefine_viz.core.model import ObjectModel
    from verefine_viz.labels.desk import LabelDesk
    from verefine_viz.run.solids_ahead import SolidsAhead
    from verefine_viz.run.toolbox import Toolbox

HULLS = {"physics": {"collider": "hull"}}
"""Settings with which no model has to be decomposed."""
MOST_TRIED = 20
"""Frames that are tried until one can be read."""
_CHEAP = {"method", "icp", "score", "physics"}
"""Sections that can change while everything else of the tools is shared."""
_WORLD = frozenset(f"physics.{name}" for name in SURROUNDINGS)
"""Settings whose change gives the same frame another world."""
_START = {"hypotheses", "dependency", "ppf", "pcs", "densefusion"}
"""Sections whose change gives other initial poses, or another order."""


@dataclass(eq=False)
class FrameWork:
    """A frame with its branches."""

    branches: dict[int, Branch]
    compare: tuple[int, int] | None = None
    """A and B."""
    looked_at: int | None = None
    """The branch that was looked at last."""

    @property
    def first(self) -> Branch:
        """The branch that the others forked from, or the oldest that remains."""
        return next(iter(self.branches.values()))

    @property
    def shown(self) -> Branch:
        """The branch that was looked at last, else the first."""
        return self.branches.get(self.looked_at if self.looked_at is not None else -1, self.first)


Records = Callable[[str], Path | None]
"""The run file of a frame that was solved before; None = there is none."""


def no_records(frame: str) -> None:
    """Return None: no frame was solved before."""


@dataclass(eq=False)
class Checks:
    """The evaluation of poses by physics; None = physics is not asked."""

    plausibility: Callable[..., Any] | None = None
    overlap: Callable[..., Any] | None = None


class Workspace:
    """The open session. Opening builds everything first and then switches, so a failure changes nothing.

    Nor does cancelling: ``core.errors.Cancelled`` is raised before the switch.

    Args:
        session: what to open first.
        path: its file, if it has one.
        make_tools: builds the algorithm's parts from a session.
        checks: see :class:`CachedEvaluator`.
        progress: checked before anything that may take seconds.
        frame: the frame to open first; None = its first.
        records: finds run files of frames that were solved before.
        recording: a recorded run that is opened in place of ``session``.
        ahead: makes solids of models while a frame is looked at; None = opening a frame waits for them.
    """

    def __init__(
        self,
        session: Session,
        path: Path | None,
        make_tools: Callable[[Session], Toolbox],
        checks: Checks | None = None,
        progress: ProgressToken = NEVER_CANCELLED,
        frame: str | None = None,
        records: Records = no_records,
        recording: Path | None = None,
        ahead: SolidsAhead | None = None,
    ) -> None:
        self.make_tools = make_tools
        self._ahead = ahead
        self.progress = progress
        self._checks = checks or Checks()
        self._numbers = count()
        self._opened = count(1)
        self.grasps = GraspTrials()
        self._desk: LabelDesk | None = None
        self.runs: Mapping[str, BatchIndex] = {}
        """The batch runs whose answers are shown, by name."""
        self.batch_run = ""
        """The batch run whose session is open; "" = none."""
        if recording is not None:
            self.open_recording(recording)
        else:
            self.open(session, path, frame, records)

    # What is open

    def open(
        self, session: Session, path: Path | None, frame: str | None = None, records: Records = no_records
    ) -> None:
        """Open another session, at the frame named, else at its first that can be read; frames that ``records`` has are
        not run again.
        """
        self.progress.checkpoint("Reading the scene: models, pictures, initial poses.")
        tools = self.make_tools(session)
        frames = tools.frames
        if not frames:
            raise InputError("the session names no frame; give scene.frames, or a data set with images")
        named = frame if frame is not None else next((e.frame for e in session.edits if e.frame in frames), None)
        candidates = frames[:MOST_TRIED] if named is None else (named,)
        first, work = self._first_readable(tools, candidates, records)
        desk = self._desk_of(tools)
        if self._desk is not None and desk is not self._desk:
            self._desk.close()
        self._desk = desk
        self.tools, self.path, self.frames, self.records = tools, path, frames, records
        self.files: dict[Path, Saved] = {} if path is None else {path.resolve(): Saved(session)}
        """Files that hold the open session, with its state when it was read or written, the latest last."""
        self.breakpoints: BreakpointSettings = session.breakpoints
        self._works = {first: work}
        self._switch(first)

    def open_frame(self, frame: str) -> None:
        """Open another frame; one that was open before is unchanged."""
        if frame not in self.frames:
            raise InputError(unknown("frame", frame, self.frames))
        if frame not in self._works:
            solved = self._solved(self.tools, frame, self.records)
            self._works[frame] = solved or self._begin(self.tools, self.tools.problem(frame, ahead=self._ahead))
        self._switch(frame)

    def open_recording(self, path: Path) -> None:
        """Open a recorded run, on its frame, at its end."""
        from verefine_viz.recording.reader import read_recording

        record = read_recording(path)
        self.progress.checkpoint("Reading the scene: models, pictures, initial poses.")
        session, frame = session_on_its_frame(record.header), record.header.frame
        tools = self.make_tools(session)
        branch = self._recorded(path, record, tools, recorded_problem(record, tools, self.make_tools))
        self.tools, self.path, self.frames, self.files, self.records = tools, None, (frame,), {}, no_records
        self.breakpoints = session.breakpoints
        self._works = {frame: FrameWork({branch.index: branch})}
        self._switch(frame)

    def close(self) -> None:
        """Release the folder's labels, so that other programs can label it."""
        if self._desk is not None:
            self._desk.close()

    @property
    def is_labelling(self) -> bool:
        """Whether frames are open for labelling."""
        return self.tools.session.scene.source == LABELLED

    @property
    def desk(self) -> LabelDesk:
        """The labels of the open folder.

        Raises:
            InputError: it is not open for labelling.
        """
        if self._desk is None:
            raise InputError("no frames are open to be labelled; open some by verefine-viz label FOLDER")
        return self._desk

    def _desk_of(self, tools: Toolbox) -> LabelDesk | None:
        """The labels of the tools' folder, opened if they are not open yet."""
        from verefine_viz.labels.desk import LabelDesk

        scene, desk = tools.session.scene, self._desk
        if scene.source != LABELLED:
            return None
        if desk is None or desk.file != Path(scene.labels):
            return LabelDesk(tools, self.progress)
        desk.use(tools)
        return desk

    def show_labelled(self, frame: str) -> None:
        """Open a frame whose labels changed; labels of other frames may have changed, too, so runs on them are
        dropped.
        """
        self._works = {frame: self._begin(self.tools, self.tools.problem(frame, ahead=self._ahead))}
        self._switch(frame)

    def begin_again(self, model: ObjectModel) -> bool:
        """Begin the frames again that show a model for which no solid could be made, or not the kind asked for.

        Returns:
            Whether the open frame is one of them.
        """
        shown = {
            frame
            for frame, work in self._works.items()
            if work.first.recording is None
            and any(one.mesh_hash == model.mesh_hash for one in work.first.run.problem.models.values())
        }
        is_here = self.frame in shown
        here = (
            {self.frame: self._begin(self.tools, self.tools.problem(self.frame, ahead=self._ahead))} if is_here else {}
        )
        self._works = {frame: work for frame, work in self._works.items() if frame not in shown} | here
        if is_here:
            self._switch(self.frame)
        return is_here

    def _switch(self, frame: str) -> None:
        self.frame, self.frame_id = frame, next(self._opened)

    @contextmanager
    def with_hulls(self) -> Iterator[None]:
        """While this lasts, frames are opened with ``physics.collider = "hull"``; frames already open do not change."""
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
        """The open frame."""
        return self._works[self.frame]

    @property
    def branches(self) -> Mapping[int, Branch]:
        """The branches of the open frame, by their numbers."""
        return self.work.branches

    @property
    def problem(self) -> Problem:
        """The open frame as its first branch solves it."""
        return self.work.first.run.problem

    def branch(self, index: int) -> Branch:
        """Return a branch of the open frame.

        Raises:
            InputError: it has no such branch (any more).
        """
        if index not in self.branches:
            raise InputError(f"there is no branch {index} on frame {self.frame} (any more)")
        return self.branches[index]

    def others_of(self, branch: Branch) -> tuple[Branch, ...]:
        """Return, of each other frame, the branch that was looked at last."""
        return tuple(work.shown for work in self._works.values() if branch.index not in work.branches)

    @property
    def solved(self) -> dict[str, list[tuple[Target, Best]]]:
        """The answers by frame, where a run was finished and has any."""
        answers: dict[str, list[tuple[Target, Best]]] = {}
        for frame, work in self._works.items():
            run = work.first.run
            if run.is_done and run.length:
                for target, best in zip(run.problem.targets, run.final_state.best, strict=True):
                    if best is not None:
                        answers.setdefault(frame, []).append((target, best))
        return answers

    @property
    def recorded_tracks(self) -> Mapping[int, tuple[RecordedPose, ...]]:
        """The poses by obj_id that another program recorded, frame by frame; none where no program did."""
        source = getattr(self.tools, "source", None)
        return source.tracks if isinstance(source, RecordedSource) else {}

    def session_of(self, branch: Branch) -> Session:
        """Return the session whose file repeats a branch, with the poses edited in other frames."""
        edits = edits_of_all(branch, self.others_of(branch), is_only_frame=len(self.frames) == 1)
        return structs.replace(branch.start, edits=edits, changes=branch.changes, breakpoints=self.breakpoints)

    # Branches

    def restart(self, branch: Branch, settings: Settings) -> None:
        """Begin again before iteration 1, with the final settings of a branch and the given changes.

        Other branches, edited poses and settings changed on the way are discarded. Other data (``data.*``) or initial
        poses (``hypotheses.*``) open the session again.
        """
        new, old = group_by_section(settings), branch.tools
        ended = [change.settings for change in sorted_changes(branch.changes)]
        read = {section: new.pop(section) for section in WITH_ITS_DATA if section in new}
        if read:
            tools = old.restarted(merged((*ended, new)))
            session = changed(tools.session, read, WITH_ITS_DATA)
            files = self.files
            starts = () if "hypotheses" in read else self.work.first.tools.session.starts
            session = structs.replace(session, breakpoints=self.breakpoints, starts=starts)
            self.open(session, self.path, self.frame)
            self.files = files
            return
        starts = self.work.first.tools.session.starts
        same = not new and not old.session.edits and not old.session.changes and old.session.starts == starts
        tools = old if same else old.restarted(merged((*ended, new)), starts)
        problem = tools.ordered(self.problem) if "dependency" in new else self.problem
        if any(name in SURROUNDINGS for name in new.get("physics", ())):
            problem = tools.surrounded(problem)
        work = self._begin(tools, problem, self.work.first.data)
        if tools is not self.tools:  # The other frames were run with the old settings.
            self._works, self.records = {}, no_records
        self.tools, self._works[self.frame] = tools, work
        self._switch(self.frame)

    def estimate(self, branch: Branch, instance_id: int, estimator: str, name: str) -> Branch:
        """Begin a new branch in which an estimator, or the session ("session"), gives the initial poses of one object.

        The frame's other branches stay; other frames start again with their own initial poses.
        """
        before = dict(self.branches)
        wanted = asked_estimators(branch.tools.session.hypotheses)
        wanted.pop((self.frame, instance_id), None)
        if estimator != "session":
            wanted[self.frame, instance_id] = estimator
        self.restart(branch, {"hypotheses.estimate": tuple((*key, by) for key, by in sorted(wanted.items()))})
        new = self.work.first
        new.name = name
        self._works[self.frame] = FrameWork({**before, new.index: new})
        return new

    def fork(self, old: Branch, k: int, settings: Settings, edit: tuple[int, int, Float] | None = None) -> Branch:
        """Fork a branch off another after iteration ``k``.

        It goes on with the final settings of the other, changed by ``settings``.
        """
        nested = group_by_section(settings)
        # The settings of a session that was read may change on the way.
        tools = old.tools.changed(merged((*(c.settings for c in old.changes), nested)))
        if tools.session == old.tools.session:
            tools = old.tools
        on_the_way = tuple(c for c in old.changes if c.after_iteration <= k)
        new = merged((*(c.settings for c in old.changes if c.after_iteration > k), nested))
        if new:
            on_the_way = (*on_the_way, Change(after_iteration=k, settings=new))
        run = old.run.fork(k, tools.method if new else None, edit)
        evaluators = tuple((after, evaluator) for after, evaluator in old.evaluators if after < k or after == 0)
        if "score" in new:
            evaluators = (*(evaluators if k else ()), (k, self._evaluator(tools)))
        name = _name(k, settings, edit)
        number, start = next(self._numbers), old.start
        return self._add(Branch(number, name, run, tools, old.data, start, on_the_way, evaluators, old.index, k))

    def refine(self, old: Branch, k: int, instance_id: int, T_cam_obj: Float, name: str) -> Branch:
        """Begin a branch in which a pose is the only hypothesis of its object, with the final settings of ``old``;
        objects that were worked on up to iteration ``k`` begin where they stand.

        A method that repeats recorded steps has none for the pose, so SIR replaces it.
        """
        problem, ended = old.run.problem, [change.settings for change in sorted_changes(old.changes)]
        here = starts_after(old.run, k, instance_id, T_cam_obj)
        elsewhere = (one for one in old.tools.session.starts if one.frame != problem.frame)
        tools = old.tools.restarted(merged(ended), (*elsewhere, *here))
        if method_of(tools.session.method.name).repeats:
            tools = tools.changed({"method": {"name": "sir"}})
        return self._add(self._new(name, tools, with_starts(problem, here), old.data))

    def begin_beside(self, base: Branch, settings: Settings) -> Branch:
        """Begin a branch from the start of the open frame, with the settings of another branch changed by
        ``settings``.
        """
        session = variant(base.tools.session, tuple(settings.items()))
        tools = self._tools_like(base.tools, session)
        between = settings_between(base.tools.session, session)
        problem, data = base.run.problem, base.data
        if any(name in _WORLD for name, _, _ in between):
            problem = tools.surrounded(problem)
        if {name.partition(".")[0] for name, _, _ in between} & _START:
            ids = {i.instance_id for i in problem.instances}
            problem = tools.problem(self.frame)
            problem = problem.only([i.instance_id for i in problem.instances if i.instance_id in ids])
            data = DataCheck(problem)
        return self._add(self._new(_listed(settings) or "same settings", tools, problem, data))

    def recorded(self, path: Path) -> Branch:
        """Read a recorded run of the open frame as a branch.

        Raises:
            InputError: it is of another frame.
        """
        from verefine_viz.recording.reader import read_recording

        record = read_recording(path)
        session, frame = session_of(record.header), record.header.frame
        check_same_frame(path, (session, frame), (self.work.first.tools.session, self.frame))
        tools = self.make_tools(session)
        return self._add(self._recorded(path, record, tools, recorded_problem(record, tools, self.make_tools)))

    def remove(self, branch: Branch) -> None:
        """Remove a branch.

        Raises:
            InputError: it is the only one.
        """
        if len(self.branches) == 1:
            raise InputError("the only branch of a frame cannot be removed; restart it instead")
        del self.work.branches[branch.index]
        if self.work.compare is not None and branch.index in self.work.compare:
            self.work.compare = None

    def _add(self, branch: Branch) -> Branch:
        self.work.branches[branch.index] = branch
        return branch

    def _solved(self, tools: Toolbox, frame: str, records: Records) -> FrameWork | None:
        """Read a frame with its finished run; None where there is no such run, or the data have changed since."""
        path = records(frame)
        if path is None:
            return None
        try:
            record = read_run_file(path)
            if not record.is_complete or not record.iterations:
                return None
            stated = session_of(record.header).tracked
            own = self.make_tools(structs.replace(tools.session, tracked=stated)) if stated else tools
            branch = self._recorded(path, record, own, own.problem(frame))
        except (InputError, SettingsError):
            return None
        branch.name = "run of the batch"
        return FrameWork({branch.index: branch})

    def _first_readable(self, tools: Toolbox, frames: Sequence[str], records: Records) -> tuple[str, FrameWork]:
        """The first readable one of some frames, noting those before it; InputError where there is none."""
        faults: list[tuple[str, InputError]] = []
        for frame in frames:
            if solved := self._solved(tools, frame, records):
                return frame, solved
            try:
                problem = tools.problem(frame, ahead=self._ahead)
                return frame, self._begin(tools, replace(problem, notes=(*problem.notes, *_passed_over(faults))))
            except InputError as error:
                faults.append((frame, error))
        raise faults[0][1]

    def _recorded(self, path: Path, record: RunRecord, tools: Toolbox, problem: Problem) -> Branch:
        run = recorded_run(record, tools, problem)
        folder = path.parent.parent if path.parent.name == "runs" else path.parent
        name = f"{folder.name}/{path.name}".removeprefix("/")
        return Branch(
            next(self._numbers), name, run, tools, DataCheck(problem), tools.session, tools.session.changes,
            self._evaluators(tools), recording=path, missing=record.missing,
        )  # fmt: skip

    def _new(self, name: str, tools: Toolbox, problem: Problem, data: DataCheck) -> Branch:
        self.progress.checkpoint(_preparing(problem, tools.session, self._ahead is None))
        start = with_its_tracked(tools.session, problem)
        run = tools.run(problem, is_prepared=self._ahead is not None)
        return Branch(
            next(self._numbers), name, run, tools, data, start, tools.session.changes, self._evaluators(tools)
        )

    def _begin(self, tools: Toolbox, problem: Problem, data: DataCheck | None = None) -> FrameWork:
        if not problem.instances and tools.session.scene.source != LABELLED:
            raise InputError(f"frame {problem.frame} holds none of the objects asked for; choose another frame")
        is_labelled = tools.session.scene.source == LABELLED
        branch = self._new("first run", tools, problem, data or DataCheck(problem, is_labelled))
        return FrameWork({branch.index: branch})

    def _tools_like(self, tools: Toolbox, session: Session) -> Toolbox:
        """Return the tools of ``session``, which share parts with ``tools`` where that is safe."""
        old = tools.session
        between = settings_between(old, session)
        is_cheap = all(name.partition(".")[0] in _CHEAP and name not in _WORLD for name, _, _ in between)
        if old.edits or old.changes or not is_cheap:
            return self.make_tools(session)
        return tools.changed(group_by_section({name: value for name, _, value in between}))

    def _evaluators(self, tools: Toolbox) -> tuple[tuple[int, CachedEvaluator], ...]:
        """Return the evaluators of a run from its start, with the changes that its session holds."""
        evaluators = [(0, self._evaluator(tools))]
        for change in sorted_changes(tools.session.changes):
            tools = tools.changed(change.settings)
            if "score" in change.settings:
                evaluators.append((change.after_iteration, self._evaluator(tools)))
        return tuple(evaluators)

    def _evaluator(self, tools: Toolbox) -> CachedEvaluator:
        return CachedEvaluator(tools, self._checks.plausibility, self._checks.overlap)


def check_same_frame(path: Path, theirs: tuple[Session, str], ours: tuple[Session, str]) -> None:
    """Check that two runs look at the same picture: session and frame.

    Raises:
        InputError: the recording at ``path`` is of another frame.
    """
    if _place_of(*theirs) != _place_of(*ours):
        raise InputError(
            f"{path} shows {_place_of(*theirs)}, A shows {_place_of(*ours)}; two runs are compared on the same frame"
        )


def _place_of(session: Session, frame: str) -> str:
    scene = session.scene
    name = Path(scene.dataset).name
    of_kind = {"bop": f"{name} {scene.split}", "demo": f"{scene.demo}, seed {scene.seed}"}
    return f"frame {frame} of {of_kind.get(scene.source, name)}"


def _preparing(problem: Problem, session: Session, has_parts: bool) -> str:
    shown = first_of(sorted({problem.models[i.obj_id].name for i in problem.instances}), 4)
    parts = "convex parts for physics and " if session.physics.enabled and has_parts else ""
    return f"Preparing: {parts}meshes to score of {shown}. Up to half a minute for a new model, else a second."


def _listed(settings: Settings) -> str:
    """List settings by their short names: exploration = 0.2."""
    short = {name: "method" if name == "method.name" else name.rpartition(".")[2] for name in settings}
    return ", ".join(f"{short[name]} = {value}" for name, value in settings.items())


def _name(k: int, settings: Settings, edit: tuple[int, int, Float] | None) -> str:
    edited = f"hypothesis {edit[1] + 1} edited" if edit is not None else ""
    return f"{', '.join(filter(None, (_listed(settings), edited))) or 'same settings'}, from iteration {k}"


def _passed_over(faults: Sequence[tuple[str, InputError]]) -> tuple[str, ...]:
    """A note about frames that cannot be read; empty where there are none."""
    if not faults:
        return ()
    n, (frame, error) = len(faults), faults[0]
    which = f"frame {frame} cannot be read and is" if n == 1 else f"{n} frames, such as {frame}, cannot be read and are"
    return (f"{which} passed over: {error}",)
