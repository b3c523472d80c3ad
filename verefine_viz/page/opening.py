"""Opens something else: a frame, a session, a built-in scene, a recording, a batch, an answer of one, or a link."""

from __future__ import annotations

from pathlib import Path

from msgspec import structs

from verefine_viz.core.errors import InputError, SettingsError, VerefineError, unknown
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import expand_home
from verefine_viz.labels.label_folder import folder_of_labels
from verefine_viz.page.gallery import Gallery, GalleryEntry, open_gallery, read_gallery
from verefine_viz.page.link import PageLink, read_link
from verefine_viz.page.messages import ViewMessage, ViewPatch
from verefine_viz.page.page_state import PageState
from verefine_viz.page.protocol import Open
from verefine_viz.page.views.gallery_answers import answers_message
from verefine_viz.run.label_session import label_session
from verefine_viz.run.session_file import load_session


def open_other(d: PageState, verb: Open, window: int | None) -> None:
    """Open what a verb names.

    Raises:
        VerefineError: it cannot be opened, or the verb names nothing.
    """
    if verb.hulls:
        with d.space.with_hulls():
            _open(d, verb, window)
    else:
        _open(d, verb, window)


def _open(d: PageState, verb: Open, window: int | None) -> None:
    space, obj = d.space, None
    if verb.answer is not None:
        entry = open_gallery(d.gallery).answer(verb.answer)
        _open_answer(d, entry)
        if verb.beside:
            path = expand_home(verb.beside)
            known = next((branch for branch in space.branches.values() if branch.recording == path), None)
            d.put_beside(space.work.first, known or space.recorded(path))
        d.show(None if verb.beside else entry.iteration, entry.row.instance_id, window)
        return
    if verb.link:
        _open_link(d, read_link(verb.link), window)
        return
    if verb.batch:
        _open_batch(d, read_gallery(expand_home(verb.batch)), window)
        return
    if verb.frame:
        space.open_frame(verb.frame)
        obj = next((i.instance_id for i in space.problem.instances if i.obj_id == verb.object), None)
    elif verb.recording:
        space.open_recording(expand_home(verb.recording))
        d.enter_run("")
    elif verb.session:
        file = expand_home(verb.session)
        space.open(load_session(file), file)
        d.enter_run("")
    elif verb.label:
        scene = space.tools.session.scene
        if scene.source not in ("bop", "folder"):
            raise InputError("frames of a folder can be labelled; open one, or use verefine-viz label FOLDER")
        split = {"split": scene.split} if scene.source == "bop" else {}
        overrides = {"scene": {**split, "frames": space.frames}}
        folder = Path(scene.dataset)
        space.open(label_session(folder, None, folder_of_labels(folder), overrides), None, space.frame)
        d.enter_run("")
    elif verb.demo:
        space.open(*_demo_session(d, verb.demo))
        d.enter_run("")
    else:
        raise InputError("open what? Name a frame, a session, a recording, a batch, a demo, an answer or a link")
    d.send_frame()
    d.repeat_recorded()
    d.show(None, obj, None)


def _open_link(d: PageState, link: PageLink, window: int | None) -> None:
    """Open what a link names; the frame that is open stays where it is unless the link names an iteration."""
    space = d.space
    frame = link.frame or space.frame
    if frame != space.frame or (link.run and link.run != d.space.batch_run):
        _enter(d, link.run or d.space.batch_run, frame)
    obj, instances = link.instance, d.space.problem.instances
    if link.object is not None:
        named = [i.instance_id for i in instances if i.obj_id == link.object]
        obj = named[0] if len(named) == 1 else None
        if not named:
            d.say(f"Frame {frame} holds no object {link.object}.", window)
        elif obj is None:
            d.say(f"Frame {frame} holds object {link.object} several times: name its instance.", window)
    elif obj is not None and obj not in [i.instance_id for i in instances]:
        obj = None
        d.say(f"Frame {frame} holds no instance {link.instance}.", window)
    branch = space.work.first if link.branch is None else space.branches.get(link.branch)
    if branch is None:
        d.say(f"Frame {frame} has no branch {link.branch} (any more).", window)
        branch = space.work.first
    total = branch.run.n_iterations
    if link.iteration is not None and link.iteration > total:
        d.say(f"The run has no iteration {link.iteration}: {total} is its last.", window)
    if link.iteration is None and frame == space.frame and obj is not None:
        d.post(ViewMessage(ViewPatch(branch=branch.index, obj=obj, arm=None)), window)
    else:
        d.show(link.iteration, obj, window, branch)


def _open_batch(d: PageState, gallery: Gallery, window: int | None) -> None:
    """Open a batch at its worst answer, with all of its answers in the gallery."""
    before, d.gallery = d.gallery, gallery
    try:
        _open_answer(d, gallery.worst)
    except VerefineError:
        d.gallery = before
        raise
    d.end_fix()
    d.post(answers_message(gallery), None)
    d.send_fix(d.known_fix())
    d.show(gallery.worst.iteration, gallery.worst.row.instance_id, window)


def _open_answer(d: PageState, entry: GalleryEntry) -> None:
    path = open_gallery(d.gallery).loose_record(entry)
    if path is None:
        _enter(d, entry.run, entry.row.frame)
        return
    d.space.open_recording(path)
    d.enter_run(entry.run)
    d.send_frame()


def _enter(d: PageState, run: str, frame: str) -> None:
    """Open a frame of a batch run, with the session of that run; without a run a frame of the open session."""
    gallery, space = d.gallery, d.space
    if not run:
        space.open_frame(frame)
    elif gallery is None or run not in gallery.runs:
        raise InputError(unknown("run", run, gallery.runs if gallery is not None else ()))
    elif space.tools.session == gallery.session(run):
        space.open_frame(frame)
    else:
        space.open(gallery.session(run), None, frame, gallery.records(run))
    d.enter_run(run)
    d.send_frame()
    d.repeat_recorded()


def _demo_session(d: PageState, name: str) -> tuple[Session, Path | None]:
    """Return the session of a built-in scene: that of the file of its name, or else the open one's settings."""
    if name not in d.demos:
        raise SettingsError(unknown("built-in scene", name, d.demos))
    own = next((path for path in d.list_sessions() if path.stem == name), None)
    session = load_session(own) if own is not None else None
    if session is not None and (session.scene.source, session.scene.demo) == ("demo", name):
        return session, own
    old = d.space.tools.session
    scene = structs.replace(old.scene, source="demo", demo=name, frames=(), objects=())
    hypotheses = structs.replace(old.hypotheses, source="perturb", files=(), estimate=())
    update = {"scene": scene, "hypotheses": hypotheses, "title": name, "edits": (), "changes": ()}
    return structs.replace(old, **update), None
