"""A run as one HTML file that opens with a double click: the page as it shows the run, without the program."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import msgspec
import numpy as np
from msgspec.structs import replace

from verefine_viz.core.arguments import checked_choice, checked_flag, checked_path, checked_text
from verefine_viz.core.errors import InputError, VerefineError, one_line, unknown
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import atomic
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import AnyAnswer, GoneAnswer, MapsAnswer, ShadedAnswer, StoredArray
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.bundle import AskedFor, InlinedBlobs, bundle, command_path, compressed, element, webp
from verefine_viz.page.frame_messages import BranchesMessage, FrameMessage
from verefine_viz.page.gallery import Gallery, GalleryEntry
from verefine_viz.page.messages import AnyMessage, FileMessage, OpenMessage
from verefine_viz.page.openable import path_of, read_openable
from verefine_viz.page.page_state import PageState
from verefine_viz.page.run_messages import RunMessage, VerdictMessage
from verefine_viz.page.sent_palette import hello
from verefine_viz.page.shared_wants import SharedBranch, WithMaps
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.pixel_maps import ALIGNED
from verefine_viz.page.wants import ANSWERS
from verefine_viz.page.workspace import Checks, Workspace

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox

Json = dict[str, Any]
Parts = tuple["Callable[[Session], Toolbox]", Checks]
"""Builds the algorithm's parts and the evaluation of poses by physics from a session."""
STEPS: dict[str, tuple[float, type]] = {
    "rendered": (1e-4, np.uint16),
    "angle": (math.radians(1), np.uint8),
    "f_d": (0.01, np.uint8),
    "f_n": (0.01, np.uint8),
    "correlation": (0.01, np.int16),
}
"""Step to which maps are rounded, the last digit that the page shows; the highest whole number means no value."""
OF_COLOUR = ("correlation", "rendered_rgb")
"""Maps that a file holds only where colour counts; they would make up a ninth of it."""
SHADED_QUALITY = 85
MOST_SCENE_BYTES = 12_000_000
"""A larger 3D view is left out of a file, and the file says so."""


@dataclass(frozen=True, eq=False)
class SharedRun:
    """All that the page knows about an open frame."""

    title: str
    messages: tuple[AnyMessage, ...]
    answers: tuple[AskedFor, ...]
    """Wants and what answers them."""
    elements: tuple[str, ...]
    """HTML of the arrays and pictures that messages and answers name."""


def share(
    what: Any, out: str | Path, frame: str | None = None, maps: WithMaps = "marked", with_scene: bool = True
) -> str:
    """Write a run as one HTML file.

    Args:
        what: a run, its record, or a path: of a recorded run (``.vfrun``, ``.rrd``), of the folder of a batch or of
            traces, or of a session, which is run to its end.
        out: the HTML file.
        frame: which one of a folder; None = the one with the worst answer of a batch, else the first.
        maps: which iterations have their score maps in the file.
        with_scene: whether the 3D view is in the file, where it is not too large.

    Returns:
        What the file shows, and what is not in it.

    Raises:
        VerefineError: it cannot be opened, or the file cannot be written.
    """
    out = checked_path(out, "out", "the name of an HTML file")
    checked_choice(maps, "maps", get_args(WithMaps))
    checked_flag(with_scene, "with_scene")
    if frame is not None:
        checked_text(frame, "frame", 'its name, as "50/1", or None')
    if out.is_dir():
        raise InputError(f"{out} is a folder, expected the name of a file")
    with tempfile.TemporaryDirectory(prefix="verefine-viz-") as folder:
        path = path_of(what, Path(folder))
        debugger = opened(path, frame)
        run = shared(debugger, f"verefine-viz view {command_path(path)}", maps)
        note = write_shared(run, end_scene(debugger) if with_scene else "", out)
        return f"Frame {debugger.space.frame} of “{one_line(run.title)}”. {note}".rstrip()


def write_shared(run: SharedRun, scene: str, out: Path) -> str:
    """Write one HTML file; return what it lacks, and why.

    Args:
        run: what the page knows of a run.
        scene: the 3D view, a page of its own; "" = none.
        out: the file.

    Raises:
        InputError: it cannot be written.
    """
    messages, elements, note = run.messages, run.elements, ""
    if 0 < len(scene) <= MOST_SCENE_BYTES:
        messages = tuple(replace(one, scene=True) if isinstance(one, FileMessage) else one for one in messages)
        elements = (*elements, element("scene3d", "text/plain", compressed(scene.encode())))
    elif scene:
        note = f"The 3D view is left out: it takes {len(scene) / 1e6:.0f} MB."
    with atomic(out) as part:
        part.write_text(bundle(messages, run.answers, elements, run.title), encoding="utf-8", errors="replace")
    return note


def opened(path: Path, frame: str | None = None) -> Debugger:
    """Open what lies at a path, at its end.

    Args:
        path: see :func:`share`.
        frame: which one of a folder; None = the one with the worst answer of a batch, else the first.

    Raises:
        VerefineError: it cannot be opened.
    """
    there = read_openable(path)
    if there.gallery is not None:
        return _opened_batch(there.gallery, frame)
    space = Workspace(there.session, there.session_path, *real_parts(), frame=frame, recording=there.recording)
    if frame not in (None, space.frame):
        raise InputError(f"{path} is of frame {space.frame}, not of {frame}; leave out --frame")
    debugger = Debugger(space).carry_out(())
    branch = space.work.first
    if not branch.run.is_done and branch.recording is None:
        debugger.carry_out([p.Seek(branch.run.n_iterations, branch.index)])  # Whatever the breakpoints.
    return debugger


def _opened_batch(gallery: Gallery, frame: str | None = None) -> Debugger:
    """Open the worst answer of a batch, or of one of its frames; the verb ``Open`` takes it to other answers.

    Raises:
        VerefineError: it cannot be opened.
    """
    frames = list(dict.fromkeys(entry.row.frame for entry in gallery.entries))
    if frame is not None and frame not in frames:
        raise InputError(unknown("frame", frame, frames))
    entry = next((e for e in gallery.sorted_by("error") if e.can_be_opened and frame in (None, e.row.frame)), None)
    if entry is None:
        raise InputError(f"{f'frame {frame}' if frame else 'the batch'} failed: there is nothing to show")
    return opened_answer(gallery, entry)


def opened_answer(gallery: Gallery, entry: GalleryEntry, parts: Parts | None = None) -> Debugger:
    """Open an answer of a batch.

    Args:
        gallery: of the batch.
        entry: the answer.
        parts: makes the session's parts, shared with answers opened before; None = its own.

    Raises:
        VerefineError: it cannot be opened.
    """
    given = {"frame": entry.row.frame, "records": gallery.records(entry.run)}
    session, recording = gallery.session(entry.run), gallery.loose_record(entry)
    space = Workspace(session, None, *(parts or real_parts()), recording=recording, **given)
    debugger = Debugger(space, gallery=gallery)
    debugger.enter_run(entry.run)
    debugger.show(entry.iteration, entry.row.instance_id, None)
    return debugger.carry_out(())


def real_parts() -> Parts:
    """A maker of sessions' parts; sessions on the same data share what was read."""
    from verefine_viz.physics.plausibility import plausibility
    from verefine_viz.physics.proximity import Surfaces, overlap
    from verefine_viz.run.toolbox import Toolbox
    from verefine_viz.scenes.source import open_scene

    surfaces, source_of = Surfaces(), cache(open_scene)

    def tools_of(session: Session) -> Toolbox:
        return Toolbox(session, source=source_of(session.scene, session.hypotheses))

    return tools_of, Checks(partial(plausibility, surface_of=surfaces), partial(overlap, surface_of=surfaces))


def shared(
    debugger: PageState,
    command: str,
    maps: WithMaps = "marked",
    objects: Collection[int] | None = None,
    prefix: str = "",
    progress: ProgressToken = NEVER_CANCELLED,
) -> SharedRun:
    """Gather what the page shows of the open frame.

    Args:
        debugger: what is open.
        command: opens it with the program.
        maps: which iterations have their score maps.
        objects: instances that are shown in depth; None = all.
        prefix: begins the keys of its arrays.
        progress: checked before each part.

    Raises:
        Cancelled: it is no longer wanted.
    """
    space, blobs = debugger.space, InlinedBlobs(prefix)
    for _ in debugger.work_out(objects):
        progress.checkpoint("Working out what the verdict may say.")
    known = [_portable(message) for message in debugger.known(blobs)]
    frame = next(message for message in known if isinstance(message, FrameMessage))
    branches = next(message for message in known if isinstance(message, BranchesMessage))
    runs = {message.branch: message for message in known if isinstance(message, RunMessage)}
    verdicts = {message.branch: message for message in known if isinstance(message, VerdictMessage)}
    wants: dict[bytes, Json] = {}
    for branch in branches.list:
        asked = SharedBranch(frame, branch, runs[branch.index], verdicts.get(branch.index), maps, objects)
        wants |= {p.encoded(of): of for of in asked.wants()}
    if branches.compare is not None:
        a, b = branches.compare.a, branches.compare.b
        done = [len(runs[index].rows) for index in (a, b)]
        wants[b"compare"] = {"what": "compare", "a": a, "b": b, "done": done}
    answers = []
    for k, of in enumerate(wants.values()):
        progress.checkpoint("Working out what the file shows.", k / len(wants))
        answers.append((of, _answer(space, of, blobs)))
    file = FileMessage(command, maps, scene=False)
    return SharedRun(frame.title, (hello(0), file, *known), tuple(answers), tuple(blobs.elements))


def end_scene(debugger: PageState) -> str:
    """Return the 3D view of the end of the first branch as a page of its own."""
    from verefine_viz.page.scene3d.scene import Scene3D
    from verefine_viz.page.scene3d.view_content import look_at_end
    from verefine_viz.page.scene3d.viser_server import Viser3DServer

    branch = debugger.space.work.first
    server = Viser3DServer()
    try:
        scene = Scene3D(server, lambda *what: None)
        scene.show(debugger.space, look_at_end(branch))
        return scene.page()
    finally:
        server.stop()


def _portable(message: OpenMessage) -> OpenMessage:
    """Return a message without paths of this machine."""
    if isinstance(message, FrameMessage):
        return replace(
            message,
            session_file=message.session_file and Path(message.session_file).name,
            recording=message.recording and Path(message.recording).name,
            dataset=Path(message.dataset).name,
            frames=[message.frame], demos=(), sessions=(), run="",
        )  # fmt: skip
    if isinstance(message, BranchesMessage):
        listed = [replace(one, recording=one.recording and Path(one.recording).name) for one in message.list]
        return replace(message, list=listed)
    return message


def _answer(space: Workspace, of: Json, blobs: InlinedBlobs) -> AnyAnswer:
    want = msgspec.convert(of, p.AnyWant)
    try:
        if not isinstance(want, p.MapsWanted | p.ShadedWanted):
            return ANSWERS[type(want)](space, want, blobs)
        exact = Blobs()
        answer = ANSWERS[type(want)](space, want, exact)
    except VerefineError as error:
        return GoneAnswer(str(error))
    if isinstance(answer, MapsAnswer):
        stored = [one for one in answer.arrays if answer.scale.colour_weight > 0 or one.name not in OF_COLOUR]
        blob, arrays = _rounded(exact.data(answer.blob), stored, blobs)
        return replace(answer, blob=blob, arrays=arrays)
    if not isinstance(answer, ShadedAnswer) or answer.url is None:
        return answer
    small = webp(exact.data(answer.url.removeprefix("/blob/")), quality=SHADED_QUALITY)
    return replace(answer, url=f"/blob/{blobs.put(small, 'image/webp')}")


def _rounded(data: bytes, arrays: Sequence[StoredArray], blobs: InlinedBlobs) -> tuple[str, list[StoredArray]]:
    """Return the blob of maps, and its arrays, with only the digits that the page shows: a quarter of the size."""
    content, table = bytearray(), list[StoredArray]()
    for one in arrays:
        values, step = np.frombuffer(data, one.dtype, one.n, one.offset), None
        if one.name in STEPS:
            least, small = STEPS[one.name]
            no_value = np.iinfo(small).max
            step = max(least, float(np.nanmax(np.abs(values), initial=0.0)) / (no_value - 1))
            values = np.where(np.isfinite(values), np.round(values / step), no_value).astype(small)
        table.append(StoredArray(one.name, values.dtype.name, len(content), one.n, step))
        content += values.tobytes()
        content += bytes(-len(content) % ALIGNED)
    return blobs.put(bytes(content)), table
