"""Writes sessions to ``sessions/`` and exports to ``sessions/runs/`` and nowhere else; a browser downloads them."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import viser
from PIL import Image as PilImage

from verefine_viz.core.errors import Cancelled, InputError, VerefineError
from verefine_viz.core.paths import atomic
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.protocols import RunState, Watcher
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.run.run_file import SUFFIX, RunFile
from verefine_viz.run.session_file import load_session, save_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.command_json import to_json
from verefine_viz.viewer.drawing.scene_page import scene_page
from verefine_viz.viewer.drawing.score_maps import maps_sheet
from verefine_viz.viewer.snapshot.build import snapshot_of
from verefine_viz.viewer.state.state import State, Unconfirmed
from verefine_viz.viewer.state.workspace import Saved, Workspace, WrittenFile, savable
from verefine_viz.viewer.text.display_names import counted

if TYPE_CHECKING:
    from verefine_viz.grasping.grasp_answer import AnswerGrasps

_NAME = re.compile(r"[\w][\w .-]{0,79}")


class Exporter:
    """The writer behind :class:`~commands.SaveSession` and :class:`~commands.Export`.

    Args:
        server: whose 3D scene is exported.
        folder: where sessions lie; exports go to its ``runs`` folder.
        progress: checked before each iteration of a recording is written.
    """

    def __init__(self, server: viser.ViserServer, folder: Path, progress: ProgressToken = NEVER_CANCELLED) -> None:
        self._server, self._folder, self._progress = server, folder, progress

    def __call__(self, state: State, command: c.Command) -> WrittenFile:
        """Writes one file, says which, and hands an export to the browser that asked for it."""
        if isinstance(command, c.SaveSession):
            return self._session(state.workspace, command)
        assert isinstance(command, c.Export)
        path = self._export(state, command).resolve()
        return WrittenFile(path, downloaded(self._server, command.client, path))

    def _session(self, space: Workspace, command: c.SaveSession) -> WrittenFile:
        path = self._folder / f"{checked_name(command.name)}.toml"
        session, note = savable(space.session, space.branch, space.others, len(space.frames))
        session = titled(session, path, space)
        if not command.replace:
            refuse_loss(path, session, space, command)
        save_session(session, path)
        space.files.pop(path.resolve(), None)  # The file written last is the last one.
        space.files[path.resolve()] = Saved(session, space.branch)
        return WrittenFile(path.resolve(), "; ".join(filter(None, (note, unused(command.waiting)))))

    def _export(self, state: State, command: c.Export) -> Path:
        ending = {
            "scene": ".html",
            "commands": "_commands.jsonl",
            "maps": "_maps.png",
            "results": ".csv",
            "recording": ".rrd",
        }[command.what]
        folder = self._folder / "runs" / "exports"
        path = free(folder / f"{stem_of(state)}{ending}")
        folder.mkdir(parents=True, exist_ok=True)
        match command.what:
            case "scene":
                write_text(path, scene_page(self._server.scene.as_html(dark_mode=True), snapshot_of(state)))
            case "commands":
                write_text(path, "".join(f"{to_json(x)}\n" for x in state.log))
            case "maps":
                sheet = maps_sheet(snapshot_of(state))
                with atomic(path) as part:
                    PilImage.fromarray(sheet).save(part, format="PNG")
            case "results":
                self._write_results(state, path)
            case "recording":
                self._record(state, path)
        return path

    def _write_results(self, state: State, path: Path) -> None:
        from verefine_viz.scenes.results_csv import ResultRow, write_results

        run = state.workspace.run
        problem = run.problem
        rows = [
            ResultRow(
                scene_id=problem.scene_id,
                im_id=problem.im_id,
                obj_id=target.instance.obj_id,
                score=best.score.score,
                T_cam_obj=best.T_cam_obj,
                time_s=sum(i.ms for i in run.iterations) / 1e3,
            )
            for target, best in zip(problem.targets, run.final_state.best, strict=True)
            if best is not None
        ]
        write_results(path, rows)

    def _record(self, state: State, path: Path) -> None:
        from verefine_viz.batch.summary import run_end
        from verefine_viz.recording.recorder import Recorder

        space = state.workspace
        run, branch = space.run, space.branch

        def grasps_of(final: RunState) -> AnswerGrasps | None:
            poses = [best and best.T_cam_obj for best in final.best]
            return state.grasps.of_answers(run.problem, branch.settings.grasp, poses)

        file = RunFile(path.with_suffix(SUFFIX), space.session)
        recorder = Recorder(
            path,
            space.session,
            run.problem,
            lambda k: branch.evaluator_of(k).verifier,
            block=1,
            refiner_of=lambda k: run.method_of(k).refiner,
            grasps_of=grasps_of,
        )
        try:
            run.show((Watched(self._progress, run.length, (file, recorder)),))
            file.finish(run_end(run, space.session, recorder.landscapes, grasps_of(run.final_state)))
            recorder.close(file.path.read_bytes())
        except Cancelled:
            recorder.close()
            path.unlink(missing_ok=True)
            raise
        finally:
            file.close()
            file.path.unlink(missing_ok=True)  # The recording has it.


@dataclass(frozen=True)
class Watched:
    """Shows a history of ``n`` iterations to other watchers, and asks before each whether to go on."""

    progress: ProgressToken
    n: int
    watchers: tuple[Watcher[RunState], ...]

    def on_start(self, state: RunState) -> None:
        self.progress.checkpoint(f"Writing the recording of {counted(self.n, 'iteration')}.")
        for watcher in self.watchers:
            watcher.on_start(state)

    def on_iteration(self, state: RunState, iteration: Iteration) -> None:
        self.progress.checkpoint(share=(iteration.index - 1) / self.n)
        for watcher in self.watchers:
            watcher.on_iteration(state, iteration)

    def on_finish(self, state: RunState) -> None:
        for watcher in self.watchers:
            watcher.on_finish(state)


def unused(waiting: tuple[str, ...]) -> str:
    """What was typed as settings and is not in the file, with how it gets there; "" = nothing was.

    As in: not in the file, as they were not in use: c 0.7 → 0.3; press “Restart with these” or “Fork here” in
    Settings, then save again
    """
    if not waiting:
        return ""
    do = "press “Restart with these” or “Fork here” in Settings, then save again"
    return f"not in the file, as they were not in use: {', '.join(waiting)}; {do}"


def checked_name(name: str) -> str:
    """A session's name as a file name.

    Raises:
        InputError: it would lead out of the folder, or is no name.
    """
    if not _NAME.fullmatch(name.strip()) or ".." in name:
        raise InputError(f"{name!r} is no name for a session; use letters, digits, blanks, dots, - and _")
    return name.strip().removesuffix(".toml")


def titled(session: Session, path: Path, space: Workspace) -> Session:
    """``session`` with the title that it gets in the file ``path``.

    A file that was read or written here keeps its title, and so does a copy of it. What was changed since is another
    session: its title is the name of its new file.
    """
    files = {file: saved.session for file, saved in space.files.items()}
    same = (there for there in files.values() if there == session.model_copy(update={"title": there.title}))
    known = files.get(path.resolve()) or next(same, None)
    is_taken = any(there.title == session.title for there in files.values())
    title = known.title if known is not None else "" if is_taken else session.title
    return session.model_copy(update={"title": title or path.stem})


def refuse_loss(path: Path, session: Session, space: Workspace, command: c.SaveSession) -> None:
    """Passes where ``path`` is free, or holds nothing that would be lost if ``session`` were written there.

    Raises:
        Unconfirmed: it holds something that would be.
    """
    if not path.exists():
        return
    try:
        what = lost(load_session(path), space.files.get(path.resolve()), session, space)
    except VerefineError:
        what = "something that is no session"
    if what:
        message = f"{path} holds {what}. Nothing was written: choose another name, or"
        raise Unconfirmed(message, "replace it", replace(command, replace=True))


def lost(there: Session, saved: Saved | None, session: Session, space: Workspace) -> str:
    """What a file that holds ``there`` loses if ``session``, that of the shown branch, is written to it; "" = nothing.

    Args:
        there: what the file holds now.
        saved: what it held when it was read or written here; None = it was not.
        session: what is to be written.
        space: what is open.
    """
    if there == session:
        return ""
    if saved is None:
        return f"another session, “{there.title or 'untitled'}”"
    if there != saved.session:
        return "changes that were made since it was opened"
    n_edits = sum(edit not in session.edits for edit in there.edits)
    parts = [counted(n_edits, "edited pose")] if n_edits else []
    if any(change not in session.changes for change in there.changes):
        parts.append("settings changed on the way")
    what = f"{' and '.join(parts)} that the shown branch does not have" if parts else ""
    other = saved.branch
    if other is None or other is space.branch or not space.is_open(other):
        return what
    if not what and other in space.others and there.model_copy(update={"edits": session.edits}) == session:
        return ""  # What it holds of another frame is written again.
    return f"another branch, “{other.name}”" + (f", with {what}" if what else "")


def stem_of(state: State) -> str:
    """What exports of the open run are called."""
    session, frame = state.workspace.branch.settings, state.workspace.frame
    title = re.sub(r"[^\w-]+", "_", session.title or session.scene.demo or "run").strip("_")[:40] or "run"
    return f"{title}_{frame.replace('/', '_')}_{session.method.name}"


def free(path: Path) -> Path:
    """``path``, or the first of ``name-2``, ``name-3``, … that does not exist."""
    candidate, k = path, 2
    while candidate.exists():
        candidate = path.with_name(f"{path.stem}-{k}{path.suffix}")
        k += 1
    return candidate


def write_text(path: Path, content: str) -> None:
    """Writes a text file, whole or not at all."""
    with atomic(path) as part:
        part.write_text(content, encoding="utf-8")


# Hands exports to the browser that asked: through an ssh tunnel there is no other way to what lies on the server.

LARGEST_BYTES = 100_000_000
"""What is larger is left on disk: the page holds a download in memory until it is whole, and 100 MB take 80 s at
10 Mbit/s."""
PART_BYTES = 16_384
"""The page's own messages wait for 128 parts at most, so that it stays in use meanwhile also on a slow line."""


def downloaded(server: viser.ViserServer, client_id: int | None, path: Path) -> str:
    """Sends a file to the browser that asked for it, and to no other; says so, or why not.

    Args:
        server: that the browser looks at.
        client_id: which one it is; None = another way, which needs no message.
        path: the file.
    """
    clients = {} if client_id is None else server.get_clients()
    client = clients.get(client_id) if client_id is not None else None
    if client is None:
        return ""
    size = path.stat().st_size
    if size > LARGEST_BYTES:
        return (
            f"its {size / 1e6:,.0f} MB are too many to download in the browser (at most "
            f"{LARGEST_BYTES / 1e6:,.0f} MB): copy it from there"
        )
    client.send_file_download(path.name, path.read_bytes(), PART_BYTES, save_immediately=True)
    return f"{'your browser' if len(clients) == 1 else 'the browser that asked'} downloads it too"
