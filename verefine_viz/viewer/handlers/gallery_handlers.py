"""Opens answers of a batch, of a point, a card or a link, or the next one in the gallery's order; and tags them."""

from __future__ import annotations

from dataclasses import replace

from verefine_viz.batch.answer_tags import Arrangement
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.scenes.frames import parse_frame
from verefine_viz.viewer.commands import (
    ArrangeGallery,
    Command,
    DeleteFilter,
    OpenAt,
    OpenFailure,
    OpenFrame,
    OpenLink,
    OpenNeighbour,
    OpenPoint,
    RefreshGallery,
    SaveFilter,
    TagAnswers,
)
from verefine_viz.viewer.state.batch_gallery import Entry, Gallery, plot_of
from verefine_viz.viewer.state.live_gallery import LiveGallery
from verefine_viz.viewer.state.page_link import read_link
from verefine_viz.viewer.state.state import State
from verefine_viz.viewer.state.view_options import ViewOptions


def open_gallery(state: State) -> Gallery:
    """The answers of the batch that is open.

    Raises:
        InputError: none is.
    """
    if state.browsing.gallery is None:
        raise InputError("no batch is open; open one with verefine-viz view FOLDER")
    return state.browsing.gallery


def arrangement(command: ArrangeGallery | SaveFilter) -> Arrangement:
    """What a command has the gallery show."""
    return Arrangement(order=command.order, only=dict(command.only), search=command.search)


def resolved(state: State, command: Command) -> Command:
    """The opening that a link, a neighbour, or a command about the gallery stands for; any other command as it is.

    Raises:
        InputError: there is no such answer.
    """
    if isinstance(command, OpenLink):
        return _linked(state, command)
    if isinstance(command, OpenNeighbour):
        return _neighbour(state, command)
    if not isinstance(command, OpenFailure | OpenPoint):
        return command
    gallery, options = open_gallery(state), state.options
    if isinstance(command, OpenPoint):
        nearest = plot_of(gallery, options.arrangement.only).nearest(command.u, command.v)
        if nearest is None:
            raise InputError("no object there; click nearer to a point")
        return gallery.opens(nearest)
    return gallery.opens(_following(gallery, state.browsing.last, options, command.direction))


def _following(gallery: Gallery, last: Entry | None, options: ViewOptions, direction: int) -> Entry:
    entries = [entry for entry in gallery.shown(options.arrangement) if entry.can_be_opened]
    if not entries:
        raise InputError("no answer passes all filters; choose other filters")
    if last not in entries:
        return entries[0 if direction > 0 else -1]
    place = entries.index(last) + direction
    if not 0 <= place < len(entries):
        raise InputError(f"that is the {'last' if direction > 0 else 'first'} answer of the list")
    return entries[place]


def _neighbour(state: State, command: OpenNeighbour) -> OpenFrame:
    space = state.workspace
    frames = sorted(space.frames, key=parse_frame)
    place = frames.index(space.frame) + command.direction
    if not 0 <= place < len(frames):
        raise InputError(f"that is the {'last' if command.direction > 0 else 'first'} frame of the session")
    return OpenFrame(frames[place])


def _linked(state: State, command: OpenLink) -> OpenAt:
    """Without an iteration the open frame stays where it is, and another begins before its first."""
    link, space = read_link(command.link), state.workspace
    frame = link.frame or space.frame
    iteration = link.iteration
    if iteration is None:
        iteration = space.run.cursor if frame == space.frame and not link.run else 0
    return OpenAt(frame, iteration, link.run, link.instance, link.object)


def _open_at(state: State, command: OpenAt) -> None:
    _enter(state, command)
    run = state.run
    run.seek(min(max(command.iteration, 0), run.length))
    state.running.goal = command.iteration if command.iteration > run.length and not run.is_done else None
    state.options = _options(state, command)
    missing = _missing(state, command)
    state.message, state.refused = missing, bool(missing)


def _missing(state: State, command: OpenAt) -> str:
    """What a link names and the open frame lacks, in words; empty where it has all."""
    problem, run = state.workspace.work.problem, state.run
    obj_ids, ids = [i.obj_id for i in problem.instances], [i.instance_id for i in problem.instances]
    words = []
    if command.object is not None and obj_ids.count(command.object) > 1:
        words.append(f"frame {problem.frame} holds object {command.object} several times: name its instance")
    elif command.object is not None and command.object not in obj_ids:
        words.append(f"frame {problem.frame}: {unknown('object', command.object, sorted(obj_ids))}")
    elif command.object is None and command.instance is not None and command.instance not in ids:
        words.append(f"frame {problem.frame}: {unknown('instance', command.instance, ids)}")
    if command.iteration > run.n_iterations:
        words.append(f"the run has no iteration {command.iteration}: {run.n_iterations} is its last")
    return "; ".join(words)


def _enter(state: State, command: OpenAt) -> None:
    """Opens the frame, with the session of its run if another one is open; of several branches the run itself."""
    browsing, workspace = state.browsing, state.workspace
    gallery = browsing.gallery
    if command.run and (gallery is None or command.run not in gallery.runs):
        raise InputError(unknown("run", command.run, gallery.runs if gallery else ()))
    run = command.run or browsing.run
    if gallery is None or workspace.tools.session == gallery.session(run):
        workspace.open_frame(command.frame)
    else:
        workspace.open(gallery.session(run), None, command.frame)
    if gallery is not None:
        browsing.run = run
        if workspace.work.comparison is None:
            workspace.work.index = 0
        browsing.last = gallery.entry(run, command.frame, command.instance)
    browsing.asked = workspace.run, command.iteration


def _options(state: State, command: OpenAt) -> ViewOptions:
    """Options with the object in focus, at the iteration, where it can be inspected."""
    browsing, options = state.browsing, state.options.afresh()
    instances = state.workspace.work.problem.instances
    asked = [i.instance_id for i in instances if command.object is not None and i.obj_id == command.object]
    focus = asked[0] if len(asked) == 1 else command.instance
    options = replace(options, focus=focus if focus in [i.instance_id for i in instances] else None)
    if options.preset == "gallery":
        options = replace(options, preset="inspect")
    if browsing.last is not None and browsing.last.is_wrong:
        options = replace(options, a="accepted", b="ground truth")
    return replace(options, stage=browsing.stage_asked_for(state.run.cursor))


def _tag(state: State, command: TagAnswers) -> None:
    gallery = open_gallery(state)
    gallery.tag([gallery.answer(key) for key in command.answers], command.tag, command.on)


def _save_filter(state: State, command: SaveFilter) -> None:
    open_gallery(state).save_filter(command.name, arrangement(command))


def _delete_filter(state: State, command: DeleteFilter) -> None:
    open_gallery(state).save_filter(command.name, None)


def _refresh(state: State, command: RefreshGallery) -> None:
    """The frames that can be chosen are those that are there now."""
    gallery, space = state.browsing.gallery, state.workspace
    if not isinstance(gallery, LiveGallery):
        return
    gallery.refresh()
    if space.tools.session == gallery.session(state.browsing.run):
        space.frames = gallery.frames(state.browsing.run)


HANDLERS = {
    OpenAt: _open_at,
    TagAnswers: _tag,
    SaveFilter: _save_filter,
    DeleteFilter: _delete_filter,
    RefreshGallery: _refresh,
}
