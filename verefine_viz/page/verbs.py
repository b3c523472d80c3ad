"""Carries out verbs: what a window may ask for, and what it does. Needs no screen."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from msgspec.structs import replace

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.writing import expand_home
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import AnswerMessage
from verefine_viz.page.branch import Branch
from verefine_viz.page.fix_verbs import fix
from verefine_viz.page.frame_messages import BreakpointsMessage
from verefine_viz.page.frame_objects import labels_of, state_of
from verefine_viz.page.gallery import open_gallery
from verefine_viz.page.label_verbs import HANDLERS as LABEL_HANDLERS
from verefine_viz.page.messages import Scene3DMessage, ViewMessage, ViewPatch
from verefine_viz.page.opening import open_other
from verefine_viz.page.page_state import Goal, PageState
from verefine_viz.page.protocol import AnyVerb, pose_matrix
from verefine_viz.page.reorder import reordered
from verefine_viz.page.views.gallery_answers import answers_message
from verefine_viz.page.wants import ANSWERS
from verefine_viz.run.breakpoints import with_changes
from verefine_viz.scenes.hypothesis_pool import asked_estimators

SOURCES = {"results": "the results files", "perturb": "the disturbed ground truth"}
"""What the page calls where initial poses come from; estimators have their names."""
_NOT_LOGGED = (
    p.Look, p.Want, p.RunVerb, p.Seek, p.Pause, p.Cancel, p.Evaluate, p.Save, p.Tag, p.Fix,
    p.Place, p.Find, p.Snap, p.Decide, p.UndoLabel, p.Carry, p.Export,
)  # fmt: skip
"""Verbs that change no record; how far a run came is logged where it stops."""


_NEW_RUNS = (p.Restart, p.Open, p.Order, p.Estimate, p.Place, p.Find, p.Snap, p.UndoLabel, p.Carry)
"""Verbs after which other runs are there: what is computed ends before them."""


class Debugger(PageState):
    """Carries out verbs on what is open."""

    def apply(self, window: int | None, verb: AnyVerb) -> None:
        """Begin to carry out a verb; a run goes on with each :meth:`tick`.

        Raises:
            VerefineError: it cannot be done; everything is as before.
            Cancelled: it is no longer wanted; everything is as before.
        """
        if isinstance(verb, (p.Restart, p.Order)):
            _check_nothing_is_lost(self, self.space.branch(verb.branch), verb)
        if isinstance(verb, _NEW_RUNS):
            self.pause()
        is_logged = not isinstance(verb, _NOT_LOGGED)
        if is_logged:
            self.log.extend(self.progress_verbs())
        HANDLERS[type(verb)](self, verb, window)
        if is_logged:
            self.log.append(_log_entry(verb))
        if not isinstance(verb, (p.Look, p.Want)):
            self.announce_running()

    def use_hulls(self, branch: int | None = None) -> None:
        """Begin a run again with hulls in place of the convex parts that it waits for; None = the one computed.

        Raises:
            UnconfirmedError: that discards other branches.
        """
        index = next(iter(self.goals)) if branch is None else branch
        self.apply(None, p.Restart(index, {"physics.collider": "hull"}, run=self.is_running))

    def carry_out(self, verbs: Iterable[AnyVerb]) -> Debugger:
        """Carry out verbs one after another, each to its end."""
        for verb in verbs:
            self.apply(None, verb)
            while self.is_running:
                self.tick()
        return self


def _log_entry(verb: AnyVerb) -> AnyVerb:
    """Return a verb without the run that it starts: how far that came is logged by itself."""
    return replace(verb, run=False) if isinstance(verb, (p.Restart, p.Fork, p.Refine, p.Compare)) else verb


# Moving on


def _look(d: PageState, verb: p.Look, window: int | None) -> None:
    if window != d.look_window:
        d.look_window = window
        d.post(Scene3DMessage(window), None)
    d.look, d.space.work.looked_at = verb, verb.branch
    d.on_look()


def _step(d: PageState, verb: p.Step, window: int | None) -> None:
    d.step(d.space.branch(verb.branch))


def _seek(d: PageState, verb: p.Seek, window: int | None) -> None:
    branch = d.space.branch(verb.branch)
    if branch.run.length < verb.k and not branch.run.is_done:
        d.compute(Goal(branch, verb.k))


def _run(d: PageState, verb: p.RunVerb, window: int | None) -> None:
    branch = d.space.branch(verb.branch)
    if branch.run.is_done:
        raise InputError("the run is over; restart it, or fork it with other settings")
    d.compute(Goal(branch, None, verb.until))


def _pause(d: PageState, verb: p.Pause | p.Cancel, window: int | None) -> None:
    d.pause()


def _break(d: PageState, verb: p.Break, window: int | None) -> None:
    d.space.breakpoints = with_changes(d.space.breakpoints, verb.changes.items())
    d.post(BreakpointsMessage(d.space.breakpoints), None)


# Branches


def _restart(d: PageState, verb: p.Restart, window: int | None) -> None:
    branch = d.space.branch(verb.branch)
    before = d.space.session_of(branch)
    d.space.restart(branch, verb.changes)
    d.send_frame()
    lost = sum(edit not in d.space.session_of(d.space.work.first).edits for edit in before.edits)
    if any(change.after_iteration > 0 for change in before.changes):
        d.say("The settings changed on the way now hold from iteration 1 on.")
    if lost:
        d.say(f"{lost} edited pose{'s are' if lost > 1 else ' is'} not moved again.")
    if verb.run:
        d.compute(Goal(d.space.work.first))


def _check_nothing_is_lost(d: PageState, branch: Branch, verb: p.Restart | p.Order) -> None:
    """Refuse a restart that discards other branches or edited poses, unless it was confirmed."""
    n_others, n_edits = len(d.space.branches) - 1, len(branch.run.edits) - len(branch.start.edits)
    lost = [f"{n_others} other branch{'es' if n_others > 1 else ''}"] if n_others else []
    lost += [f"{n_edits} edited pose{'s' if n_edits > 1 else ''}"] if n_edits > 0 else []
    if lost and not verb.discard:
        text = f"A restart discards {' and '.join(lost)} of this frame."
        raise p.UnconfirmedError(text, "Restart all the same", replace(verb, discard=True))


def _fork(d: PageState, verb: p.Fork, window: int | None) -> None:
    old, edit = d.space.branch(verb.branch), verb.edit
    moved = None if edit is None else (edit.obj, edit.arm, pose_matrix(edit.T))
    k = min(verb.k, old.run.length)
    if moved is not None and old.recording is None:  # Of a recording it would be computed again.
        _check_goes_on(old, k, moved)
    branch = d.space.fork(old, k, verb.changes, moved)
    d.send_branches()
    d.send_rows(branch)
    d.post(ViewMessage(ViewPatch(branch=branch.index, k=branch.run.length, edited=None)), window)
    if verb.run and not branch.run.is_done:
        d.compute(Goal(branch))
    elif branch.run.is_done:
        d.say("Nothing is left to run after the last iteration. Fork at an earlier one.", window)


def _check_goes_on(old: Branch, k: int, edit: tuple[int, int, Float]) -> None:
    """Check that a branch would go on from an edited pose.

    Raises:
        UnconfirmedError: no iteration is left for the object.
    """
    tried, own = old.run.fork(k, edit=edit), edit[0]
    if not state_of(tried.state, old.run.problem.target(own)).edited_arms:
        label = labels_of(old.run.problem)[own]
        refine = p.Refine(own, tuple(edit[2].ravel().tolist()), k, old.index)
        text = f"no iteration is left for {label} at iteration {k}, so nothing can go on from the edited pose"
        raise p.UnconfirmedError(text, "Refine this pose", refine)


def _refine(d: PageState, verb: p.Refine, window: int | None) -> None:
    old = d.space.branch(verb.branch)
    old.run.problem.target(verb.obj)  # InputError where there is none.
    label, T_cam_obj = labels_of(old.run.problem)[verb.obj], pose_matrix(verb.T)
    branch = d.space.refine(old, min(verb.k, old.run.length), verb.obj, T_cam_obj, f"{label} from an edited pose")
    d.send_branches()
    d.send_rows(branch)
    d.post(ViewMessage(ViewPatch(branch=branch.index, k=0, obj=verb.obj, edited=None)), window)
    if verb.run:
        d.compute(Goal(branch))


def _branch(d: PageState, verb: p.BranchVerb, window: int | None) -> None:
    branch = d.space.branch(verb.index)
    if verb.remove:
        d.pause(branch.index)
        d.space.remove(branch)
    elif verb.name.strip():
        branch.name = verb.name.strip()
    d.send_branches()


def _compare(d: PageState, verb: p.Compare, window: int | None) -> None:
    space, a = d.space, d.space.branch(verb.a)
    if verb.stop:
        space.work.compare = None
        d.send_branches()
        return
    if verb.recording:
        b = space.recorded(expand_home(verb.recording))
    elif verb.changes is not None:
        b = space.begin_beside(a, verb.changes)
    elif verb.b is not None:
        b = space.branch(verb.b)
    else:
        raise InputError("compare with what? Name a branch, a recording, or settings to change")
    d.put_beside(a, b)
    if verb.run and not b.run.is_done:
        d.compute(Goal(b))


def _estimate(d: PageState, verb: p.Estimate, window: int | None) -> None:
    space, branch, instance_id = d.space, d.space.branch(verb.branch), verb.obj
    labels = labels_of(space.problem)
    if instance_id not in labels:
        raise InputError(unknown("instance", instance_id, list(labels)))
    label, settings = labels[instance_id], branch.tools.session.hypotheses
    if verb.estimator == "session" and (space.frame, instance_id) not in asked_estimators(settings):
        raise InputError(f"{label} already has the session's initial poses; choose ppf or pcs to estimate others")
    now = settings.source if verb.estimator == "session" else verb.estimator
    new = space.estimate(branch, instance_id, verb.estimator, f"{label} from {SOURCES.get(now, now)}")
    n = len(new.run.problem.target(instance_id).instance.hypotheses)
    d.send_frame()
    d.post(ViewMessage(ViewPatch(branch=new.index, k=0, obj=instance_id)), None)
    d.say(f"{label} now has {n} initial pose{'s' if n != 1 else ''}; the run before is still there as a branch.")


def _order(d: PageState, verb: p.Order, window: int | None) -> None:
    branch = d.space.branch(verb.branch)
    d.space.restart(branch, reordered(d.space, branch, verb))
    d.send_frame()


# Answers and files


def _want(d: PageState, verb: p.Want, window: int | None) -> None:
    d.post(AnswerMessage(verb.id, ANSWERS[type(verb.of)](d.space, verb.of, d.blobs)), window)
    if isinstance(verb.of, p.PhysicsWanted) and window == d.look_window:
        d.on_look()  # Overlaps and supports are known now.


def _evaluate(d: PageState, verb: p.Evaluate, window: int | None) -> None:
    from verefine_viz.page.views.grasp import grasp

    d.post(AnswerMessage(verb.id, grasp(d.space, verb, d.blobs, d.progress)), window)


def _save(d: PageState, verb: p.Save, window: int | None) -> None:
    if d.write is None:
        raise InputError("nothing can be written here")
    d.post(d.write(d, verb), window)


def _tag(d: PageState, verb: p.Tag, window: int | None) -> None:
    gallery = open_gallery(d.gallery)
    gallery.tag([gallery.answer(key) for key in verb.answers], verb.tag, verb.on)
    d.post(answers_message(gallery), None)


HANDLERS: dict[type, Callable[[PageState, Any, int | None], None]] = {
    p.Look: _look,
    p.Step: _step,
    p.Seek: _seek,
    p.RunVerb: _run,
    p.Pause: _pause,
    p.Cancel: _pause,
    p.Break: _break,
    p.Restart: _restart,
    p.Fork: _fork,
    p.Refine: _refine,
    p.BranchVerb: _branch,
    p.Compare: _compare,
    p.Estimate: _estimate,
    p.Order: _order,
    p.Open: open_other,
    p.Want: _want,
    p.Evaluate: _evaluate,
    p.Save: _save,
    p.Tag: _tag,
    p.Fix: fix,
    **LABEL_HANDLERS,
}
