"""The state of a page: what is open, which runs are computed, and what windows are sent. Needs no screen."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any

from verefine_viz.batch.fix_command import FixRequest
from verefine_viz.batch.fix_files import fix_folder, read_fix
from verefine_viz.batch.fix_thread import FixState, FixThread
from verefine_viz.core.errors import InputError
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.methods.known_methods import method_of
from verefine_viz.page import protocol as p
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.branch import Branch
from verefine_viz.page.frame_messages import FrameMessage
from verefine_viz.page.gallery import Gallery
from verefine_viz.page.live_gallery import LiveGallery
from verefine_viz.page.marks import jumps
from verefine_viz.page.messages import (
    DoubtsMessage,
    NoteMessage,
    OpenMessage,
    ReadyMessage,
    RunningMessage,
    Scene3DMessage,
    ViewMessage,
    ViewPatch,
    WrittenMessage,
)
from verefine_viz.page.protocol import AnyVerb
from verefine_viz.page.run_messages import VerdictMessage
from verefine_viz.page.session_titles import titled
from verefine_viz.page.views.branch_list import branches_message
from verefine_viz.page.views.doubts import shown_doubts
from verefine_viz.page.views.frame import frame_message
from verefine_viz.page.views.gallery_answers import answers_message
from verefine_viz.page.views.label_list import labels_message
from verefine_viz.page.views.rows import run_message
from verefine_viz.page.views.tried_remedies import fix_message
from verefine_viz.page.views.verdict import finished_objects, verdict_message
from verefine_viz.page.worker import Post
from verefine_viz.page.workspace import Workspace
from verefine_viz.run.breakpoints import hits

ROWS_S = 0.1
"""Time between two messages with the rows of a running run [s]."""
_TIMED = 20
"""Number of latest iterations whose mean duration predicts the others'."""


class Goal:
    """A goal up to which a branch is computed.

    Args:
        branch: which.
        k: number of iterations to reach, whatever the breakpoints; None = to its end, or to a breakpoint.
        until: "end", or "event": the first mark stops it, too.
    """

    def __init__(self, branch: Branch, k: int | None = None, until: str = "end") -> None:
        self.branch, self.k, self.until = branch, k, until
        self.seconds: deque[float] = deque(maxlen=_TIMED)

    @property
    def is_reached(self) -> bool:
        """Whether nothing is left to compute."""
        run = self.branch.run
        return run.is_done or (self.k is not None and run.length >= self.k)

    @property
    def remaining_s(self) -> float | None:
        """Estimated time to the goal [s]; None where nothing was timed yet."""
        if not self.seconds:
            return None
        run = self.branch.run
        return ((self.k or run.n_iterations) - run.length) * sum(self.seconds) / len(self.seconds)


class PageState:
    """What is open, and what happens to it.

    Args:
        space: the open session.
        post: sends messages to windows; None where there are none.
        blobs: where binary arrays are held for them.
        gallery: the answers of a batch; None = no batch is open.
        demos: names of the built-in scenes.
        sessions: lists the session files that lie at hand.
        write: writes a file for ``Save``; None = nothing can be written.
        progress: checked between the parts of long work.
    """

    def __init__(
        self,
        space: Workspace,
        post: Post = lambda message, window: None,
        blobs: Blobs | None = None,
        gallery: Gallery | None = None,
        demos: Sequence[str] = (),
        sessions: Callable[[], Sequence[Path]] = tuple,
        write: Callable[[PageState, p.Save], WrittenMessage] | None = None,
        progress: ProgressToken = NEVER_CANCELLED,
    ) -> None:
        self.space, self.post, self.blobs = space, post, blobs or Blobs()
        self.gallery, self.demos, self.list_sessions = gallery, demos, sessions
        self.write, self.progress = write, progress
        self.enter_run(gallery.worst.run if gallery is not None else "")
        self.goals: dict[int, Goal] = {}
        """What is computed, by branch; in turns where there are several."""
        self.stopped = ""
        """The breakpoint at which a run stopped last; "" once one goes on."""
        self.log: list[AnyVerb] = []
        """Verbs that changed a record; carried out again they give the same records."""
        self.look: p.Look | None = None
        """What the window used last looks at."""
        self.look_window: int | None = None
        self.on_look: Callable[[], None] = lambda: None
        """Called to draw the 3D view."""
        self._sent: dict[int, int] = {}
        """Rows of each branch that windows have."""
        self._sent_at = 0.0
        self._judged: dict[int, int] = {}
        """Branches whose verdict windows have, and of how many iterations."""
        self._later: Iterator[None] | None = self._warm_up()
        self._checked: Branch | None = None
        """The first branch, once windows have the doubts about its data; the frame is shown before these are known."""
        self.fix: FixThread | None = None
        """The trial of remedies on the runs of the gallery, running or finished."""
        self.repeat_recorded()

    # Computing

    @property
    def is_running(self) -> bool:
        """Whether a branch is computed."""
        return bool(self.goals)

    def compute(self, goal: Goal) -> None:
        """Have a branch computed to a goal, beside the branches already being computed."""
        self.goals[goal.branch.index], self.stopped = goal, ""

    def tick(self) -> None:
        """Compute one iteration of the branch whose turn it is."""
        if not self.goals:
            return
        index, goal = next(iter(self.goals.items()))
        run = goal.branch.run
        if not goal.is_reached:
            began = perf_counter()
            run.seek(run.length)
            iteration = run.step()
            goal.seconds.append(perf_counter() - began)
            reasons = hits(self.space.breakpoints, run.problem, iteration) if goal.k is None else ()
            if reasons and not run.is_done:
                self.stopped = f"Breakpoint at iteration {iteration.index}: {'; '.join(reasons)}"
                self.pause(index)
                return
            if goal.until == "event" and iteration.index in jumps(goal.branch.marks()):
                self.pause(index)
                return
        if goal.is_reached:
            self.pause(index)
            return
        self.goals[index] = self.goals.pop(index)  # The next branch has its turn.
        if monotonic() - self._sent_at > ROWS_S:
            for other in self.goals.values():
                self.send_rows(other.branch)
            self.announce_running()

    def pause(self, index: int | None = None) -> None:
        """Stop computing a branch, or all; the log says how far each got."""
        stopped = [goal for i, goal in self.goals.items() if index in (None, i)]
        if not stopped:
            return
        self.log.extend(p.Seek(goal.branch.run.length, goal.branch.index) for goal in stopped)
        for goal in stopped:
            del self.goals[goal.branch.index]
            self.send_rows(goal.branch)
        self.announce_running()

    def progress_verbs(self) -> list[AnyVerb]:
        """Return verbs that compute the running branches as far as they are now."""
        return [p.Seek(goal.branch.run.length, goal.branch.index) for goal in self.goals.values()]

    def enter_run(self, run: str) -> None:
        """Note which batch run the open session is of; "" = none."""
        self.space.batch_run = run
        self.space.runs = {} if self.gallery is None else self.gallery.runs

    def repeat_recorded(self) -> None:
        """Take all steps that another program recorded, as its run is over: it opens at its end."""
        branch = self.space.work.first
        if method_of(branch.settings.method.name).repeats and not branch.run.is_done:
            self.compute(Goal(branch, branch.run.n_iterations))

    def show(self, iteration: int | None, obj: int | None, window: int | None, branch: Branch | None = None) -> None:
        """Take a window to an iteration of a branch, computing the whole run where that iteration was not made yet.

        Args:
            iteration: 0 = before the first; None = the latest.
            obj: in focus; None = that of the iteration.
            window: which; None = all.
            branch: None = the first.
        """
        branch = branch or self.space.work.first
        run = branch.run
        patch = ViewPatch(branch=branch.index, obj=obj, stage=None, arm=None, moment=None)
        at = None if iteration is None else min(iteration, run.n_iterations)
        self.post(ViewMessage(patch, at), window)
        if iteration is not None and not run.is_done:
            self.compute(Goal(branch, run.n_iterations))

    def refresh_gallery(self) -> None:
        """Take over the present answers of a watched folder."""
        space = self.space
        if not isinstance(self.gallery, LiveGallery):
            return
        self.gallery = gallery = self.gallery.refreshed()
        space.runs = gallery.runs
        frames = None
        if self.space.batch_run and space.tools.session == gallery.session(self.space.batch_run):
            frames = space.frames = gallery.frames(self.space.batch_run)
        self.post(answers_message(gallery, frames), None)

    def put_beside(self, a: Branch, b: Branch) -> None:
        """Show two branches side by side."""
        self.space.work.compare = (a.index, b.index)
        self.send_branches()
        self.send_rows(b)

    # Remedies

    def known_fix(self) -> FixState:
        """Return the progress of the remedies on the runs of the gallery, or an earlier trial's table."""
        if self.fix is not None:
            return self.fix.latest
        folder = None if self.gallery is None else self.gallery.folder
        with suppress(InputError):  # A damaged table counts as none: a new trial writes it again.
            return FixState(table=None if folder is None else read_fix(folder))
        return FixState()

    def begin_fix(self, request: FixRequest, n_workers: int) -> None:
        """Begin to try remedies beside what is open."""
        self.fix = FixThread(request, n_workers, self.send_fix)
        self.send_fix(self.fix.latest)
        self.fix.start()

    def end_fix(self) -> None:
        """End the trial of remedies; frames already solved are kept."""
        if self.fix is not None:
            self.fix.stop()
        self.fix = None

    def send_fix(self, state: FixState, window: int | None = None) -> None:
        """Send the progress of the remedies. Callable from any thread."""
        if self.gallery is not None and self.gallery.folder is not None:
            self.post(fix_message(self.gallery, state, fix_folder(self.gallery.folder)), window)

    def begin_again(self, model: ObjectModel) -> None:
        """Begin the open frame again where it shows a model whose solid is not as asked for."""
        if self.space.begin_again(model):
            self.goals = {}
            self.send_frame()
            self.announce_running()
            self.say(f"The frame begins again: {model.name} has other convex parts than were asked for; see its notes.")

    def step(self, branch: Branch) -> None:
        """Compute one iteration at the end of a branch."""
        if branch.run.is_done:
            raise InputError("the run is over; restart it, or fork it with other settings")
        branch.run.seek(branch.run.length)
        branch.run.step()
        self.send_rows(branch)

    # What windows get

    def known(self, blobs: Blobs) -> Iterator[OpenMessage]:
        """Return the messages that say all that is known of the open frame; ``blobs`` gets their arrays."""
        yield self._frame(blobs)
        yield branches_message(self.space)
        for branch in self.space.branches.values():
            yield run_message(branch, 0, self.space.work.first)
            if branch.is_over:
                yield self._verdict(branch)

    def work_out(self, objects: Collection[int] | None = None) -> Iterator[None]:
        """Work out, piece by piece, the doubts and what the verdicts still lack about some objects; None = all."""
        for branch in self.space.branches.values():
            branch.data.doubts()
            yield
            if branch.is_over:
                yield from self._work_out(branch, objects)

    def welcome(self, window: int) -> None:
        """Send a window that has just connected all that is known."""
        for message in self.known(self.blobs):
            self.post(message, window)
        for branch in self.space.branches.values():
            self._sent[branch.index] = branch.run.length
            if branch.is_over:
                self._judge(branch)
        if self.gallery is not None:
            self.post(answers_message(self.gallery), window)
            self.send_fix(self.known_fix(), window)
        self.send_labels(window)
        self.announce_running(window)
        self.post(Scene3DMessage(self.look_window), window)
        self.post(ReadyMessage(), window)

    def window_closed(self, window: int) -> None:
        """Note that a window is closed: the 3D view is free for another one."""
        if window == self.look_window:
            self.look_window = None
            self.post(Scene3DMessage(None), None)

    def say(self, text: str, window: int | None = None) -> None:
        """Show a few words."""
        self.post(NoteMessage(text), window)

    def send_frame(self) -> None:
        """Send everything again, after a change of frame, session or start."""
        self._sent, self._judged, self._later = {}, {}, None
        self.post(self._frame(self.blobs), None)
        self.send_branches()
        for branch in self.space.branches.values():
            self.send_rows(branch)
        self.send_labels()

    def send_labels(self, window: int | None = None) -> None:
        """Send the labels of the frame, if it is open for labelling."""
        if self.space.is_labelling:
            self.post(labels_message(self.space.desk, self.space.frame), window)

    def send_branches(self) -> None:
        """Send the list of branches."""
        self.post(branches_message(self.space), None)

    def send_rows(self, branch: Branch) -> None:
        """Send the iterations that windows do not have, and the verdict once the run is over."""
        self.post(run_message(branch, self._sent.get(branch.index, 0), self.space.work.first), None)
        self._sent[branch.index], self._sent_at = branch.run.length, monotonic()
        if branch.is_over and self._judge(branch):
            self.post(self._verdict(branch), None)

    def _judge(self, branch: Branch) -> bool:
        """Have the missing parts of a finished run's verdict worked out, once; return whether this was the first
        time.
        """
        if self._judged.get(branch.index) == branch.run.length:
            return False
        self._judged[branch.index] = branch.run.length
        self._later = self._work_out(branch)
        return True

    def announce_running(self, window: int | None = None) -> None:
        """Say which branch is computed, and how long it will take."""
        left = [goal.remaining_s for goal in self.goals.values()]
        remaining_s = sum(s for s in left if s is not None) if any(s is not None for s in left) else None
        running = RunningMessage(next(iter(self.goals), None), list(self.goals), self.stopped, remaining_s)
        self.post(running, window)

    def _frame(self, blobs: Blobs) -> FrameMessage:
        sessions = self.list_sessions()
        shown = {path.stem for path in sessions if path.stem.startswith("failure_")}  # Listed by title.
        demos = [name for name in self.demos if name not in shown]
        return frame_message(self.space, blobs, self.space.batch_run, demos, titled(sessions))

    def _verdict(self, branch: Branch) -> VerdictMessage:
        return verdict_message(branch, self.batch_rows(branch))

    def batch_rows(self, branch: Branch) -> dict[int, Any]:
        """Return the batch's answers for the frame, by instance; none for a branch that is not the batch's run."""
        gallery, space = self.gallery, self.space
        if (
            gallery is None
            or not self.space.batch_run
            or branch is not space.work.first
            or (branch.recording is None and branch.settings.method != gallery.session(self.space.batch_run).method)
        ):
            return {}
        made_by = branch.settings.method.name
        rows = (
            row for row in gallery.runs[self.space.batch_run].rows if (row.frame, row.method) == (space.frame, made_by)
        )
        return {row.instance_id: row for row in rows if row.instance_id is not None}

    # Work aside

    def later(self) -> bool:
        """Work out a missing piece of doubts and verdict; return whether there is more."""
        first = self.space.work.first
        if self._checked is not first:
            self._checked = first
            if doubts := shown_doubts(first):
                self.post(DoubtsMessage(doubts), None)
            return True
        if self._later is None:
            return False
        try:
            next(self._later)
        except StopIteration:
            self._later = None
        return self._later is not None

    def _warm_up(self) -> Iterator[None]:
        """Make a first step and discard it, so that the first real one need not wait for its kernels."""
        run = self.space.work.first.run
        yield
        with suppress(Exception):  # An error is reported when the step is made in earnest.
            if not run.is_done:
                run.method.step(run.state)

    def _work_out(self, branch: Branch, only: Collection[int] | None = None) -> Iterator[None]:
        """Work out physics, then the score around the answers, of objects whose verdict may change by it."""
        evaluator = branch.final_evaluator
        answered = [o for o in finished_objects(branch) if o.answer is not None]
        placed = [Placed(o.instance_id, o.target.model, o.answer.T_cam_obj) for o in answered if o.answer is not None]
        objects = [o for o in answered if only is None or o.instance_id in only]
        unknown_truth = [o for o in objects if o.errors is None]
        for o in unknown_truth:
            assert o.answer is not None
            others = [other for other in placed if other.instance_id != o.instance_id]
            evaluator.plausibility(o.target, o.answer.T_cam_obj, others)
            yield
        if unknown_truth:
            self.post(self._verdict(branch), None)
        for o in objects:
            assert o.answer is not None
            evaluator.near_symmetries(o.target.model)
            yield
            evaluator.allowed(o.target, o.answer.T_cam_obj, branch.run.iterations)
            yield
            T_gt = o.target.instance.T_cam_obj_gt
            if o.is_wrong and T_gt is not None:
                evaluator.allowed(o.target, T_gt, branch.run.iterations)
                yield
        self.post(self._verdict(branch), None)
