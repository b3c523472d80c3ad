"""Writes sessions to the folder of sessions, exports to ``runs/exports`` in it; hands page and film to the browser."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from msgspec import structs
from PIL import Image

from verefine_viz.core.errors import Cancelled, InputError, VerefineError
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.protocols import RunState, Watcher
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import atomic
from verefine_viz.page.branch import Branch
from verefine_viz.page.film_file import write_film
from verefine_viz.page.maps_sheet import maps_sheet
from verefine_viz.page.messages import WrittenMessage
from verefine_viz.page.page_state import PageState
from verefine_viz.page.protocol import AnyVerb, Save, UnconfirmedError, write_verb
from verefine_viz.page.saved_session import Saved, savable
from verefine_viz.page.share import shared, write_shared
from verefine_viz.page.workspace import Workspace
from verefine_viz.run.run_file import SUFFIX, RunFile
from verefine_viz.run.session_file import load_session, save_session
from verefine_viz.run.session_parts import weights_of

_NAME = re.compile(r"[\w][\w .-]{0,79}")
ENDINGS = {
    "recording": (".rrd", SUFFIX),
    "share": (".html",),
    "results": (".csv",),
    "maps": ("_maps.png",),
    "film": ("_film.png", "_film.gif"),
    "verbs": ("_verbs.jsonl",),
}
"""Endings of files, by what is written; the first where none is named."""
FOR_THE_BROWSER = ("share", "film")
"""Files that the browser downloads, kept nowhere else."""


class Exporter:
    """Writes what ``Save`` asks for.

    Args:
        folder: where sessions lie; exports go to ``runs/exports`` in it.
        progress: checked before each iteration of a recording is written.
        scene_page: returns the present 3D view as a page of its own.
    """

    def __init__(
        self,
        folder: Path,
        progress: ProgressToken = NEVER_CANCELLED,
        scene_page: Callable[[], str] = lambda: "",
    ) -> None:
        self._folder, self._progress, self._scene_page = folder, progress, scene_page
        self._written: dict[str, Path] = {}
        self._handed: TemporaryDirectory[str] | None = None
        """Folder of the page or film that was handed over last, which the browser downloads."""

    def __call__(self, d: PageState, verb: Save) -> WrittenMessage:
        """Write a file and return message ``written``.

        Raises:
            VerefineError: it cannot be written, or would replace something.
            Cancelled: the file is no longer wanted, and none is left.
        """
        note = ""
        if verb.what == "session":
            path, note = self._session(d.space, verb)
        elif verb.what in FOR_THE_BROWSER:
            path = self._hand_over(d, verb)
        else:
            path = self._export(d, verb)
        path = path.resolve()
        self._written[path.name] = path
        stays = str(path) if verb.what not in FOR_THE_BROWSER else None
        return WrittenMessage(path.name, stays, f"/file/{path.name}", note)

    def close(self) -> None:
        """Remove the file that was only there to be downloaded."""
        if self._handed is not None:
            self._handed.cleanup()

    def file(self, name: str) -> Path | None:
        """Return the file of a name that was written last. Callable from any thread."""
        return self._written.get(name)

    def _session(self, space: Workspace, verb: Save) -> tuple[Path, str]:
        path, branch = self._folder / f"{checked_name(verb.name)}.toml", space.branch(verb.branch)
        session, note = savable(space.session_of(branch), branch, space.others_of(branch), len(space.frames))
        session = titled(session, path, space)
        if not verb.replace and path.exists():
            _refuse_loss(path, session, branch, space, verb)
        save_session(session, path)
        space.files.pop(path.resolve(), None)  # The file written last goes to the end.
        space.files[path.resolve()] = Saved(session, branch)
        return path, note

    def _hand_over(self, d: PageState, verb: Save) -> Path:
        """Write the page or a film as a file that is kept until the next one is written, or the program ends."""
        self.close()
        self._handed = TemporaryDirectory(prefix="verefine-viz-")
        branch = d.space.branch(verb.branch)
        path = Path(self._handed.name) / file_name(verb, branch)
        if verb.what == "film":
            write_film(d, path, branch, verb.obj)
        else:
            write_shared(shared(d, _view_command(d.space), progress=self._progress), self._scene_page(), path)
        return path

    def _export(self, d: PageState, verb: Save) -> Path:
        branch = d.space.work.first if verb.what == "verbs" else d.space.branch(verb.branch)
        path = free(self._folder / "runs" / "exports" / file_name(verb, branch))
        path.parent.mkdir(parents=True, exist_ok=True)
        if verb.what == "recording":
            self._record(d.space, branch, path)
        elif verb.what == "results":
            _write_answers(branch, path)
        elif verb.what == "maps":
            with atomic(path) as part:
                Image.fromarray(maps_sheet(branch, verb)).save(part, format="PNG")
        else:
            with atomic(path) as part:
                part.write_text("".join(f"{write_verb(one)}\n" for one in logged(d)), encoding="utf-8")
        return path

    def _record(self, space: Workspace, branch: Branch, path: Path) -> None:
        """Write a branch as a recording, which carries its run file, or as the run file alone."""
        from verefine_viz.batch.summary import run_end
        from verefine_viz.diagnosis.films import films_of
        from verefine_viz.grasping.grasp_answer import answer_grasps
        from verefine_viz.recording.reader import read_recording
        from verefine_viz.recording.recorder import Recorder

        run, session, settings = branch.run, space.session_of(branch), branch.settings.grasp
        poses = [best and best.T_cam_obj for best in run.final_state.best]
        grasps = answer_grasps(run.problem, poses, settings) if settings.answers else None
        weights = weights_of(session)
        file = RunFile(path.with_suffix(SUFFIX), session, weights)
        recorder = None
        if path.suffix != SUFFIX:
            recorder = Recorder(
                path,
                session,
                run.problem,
                lambda k: branch.evaluator_of(k).verifier,
                block=1,
                refiner_of=lambda k: run.method_of(k).refiner,
                grasps_of=lambda state: grasps,
                weights=weights,
                films_of=lambda record: films_of(record, run.problem, lambda k: branch.evaluator_of(k).verifier),
            )
        watchers = (file,) if recorder is None else (file, recorder)
        try:
            run.show((CheckedHistory(self._progress, run.length, watchers),))
            if branch.recording is not None:
                end = read_recording(branch.recording).end
            else:
                known = recorder.allowed if recorder is not None else {}
                end = run_end(run, session, known, grasps) if run.is_done else None
            if end is not None:
                file.finish(end)
            file.close()
            if recorder is not None:
                recorder.close(file.path.read_bytes())
        except Cancelled:
            if recorder is not None:
                recorder.close()
            for left in {path, file.path}:
                left.unlink(missing_ok=True)
            raise
        finally:
            file.close()
            if recorder is not None:  # The recording holds the run file.
                file.path.unlink(missing_ok=True)


@dataclass(frozen=True)
class CheckedHistory:
    """Shows a history of ``n`` iterations to watchers, checking before each whether to go on."""

    progress: ProgressToken
    n: int
    watchers: tuple[Watcher[RunState], ...]

    def on_start(self, state: RunState) -> None:
        self.progress.checkpoint(f"Writing {self.n} iteration{'s' * (self.n != 1)}.")
        for watcher in self.watchers:
            watcher.on_start(state)

    def on_iteration(self, state: RunState, iteration: Iteration) -> None:
        self.progress.checkpoint(share=(iteration.index - 1) / self.n)
        for watcher in self.watchers:
            watcher.on_iteration(state, iteration)

    def on_finish(self, state: RunState) -> None:
        for watcher in self.watchers:
            watcher.on_finish(state)


def logged(d: PageState) -> list[AnyVerb]:
    """Return the verbs that lead to the present state; a running branch as far as it is now."""
    return [*d.log, *d.progress_verbs()]


def _write_answers(branch: Branch, path: Path) -> None:
    """Write the best poses so far as a BOP results file."""
    from verefine_viz.scenes.results_csv import ResultRow, write_results

    run, problem = branch.run, branch.run.problem
    seconds = sum(iteration.ms for iteration in run.iterations) / 1e3
    rows = [
        ResultRow(
            scene_id=problem.scene_id,
            im_id=problem.im_id,
            obj_id=target.instance.obj_id,
            score=best.score.score,
            T_cam_obj=best.T_cam_obj,
            time_s=seconds,
        )
        for target, best in zip(problem.targets, run.final_state.best, strict=True)
        if best is not None
    ]
    write_results(path, rows)


def _view_command(space: Workspace) -> str:
    """Return the command that opens the same again."""
    recording = space.work.first.recording
    file = recording if recording is not None else next(reversed(space.files), None)
    return f"verefine-viz view {file.name if file is not None else ''}".rstrip()


# Names and titles


def checked_name(name: str) -> str:
    """Return a name as that of a file in the folder.

    Raises:
        InputError: it would lead out of the folder, or is no name.
    """
    if not _NAME.fullmatch(name.strip()) or ".." in name:
        raise InputError(f"{name!r} is no name of a file; use letters, digits, blanks, dots, - and _")
    return name.strip().removesuffix(".toml")


def file_name(verb: Save, branch: Branch) -> str:
    """Return the name of the file that a verb asks for.

    Raises:
        InputError: its name is not a file name.
    """
    endings = ENDINGS[verb.what]
    ending = next((one for one in endings if verb.name.endswith(one)), endings[0])
    stem = verb.name.removesuffix(ending)
    return f"{checked_name(stem) if stem else _stem_of(branch)}{ending}"


def _stem_of(branch: Branch) -> str:
    """Return the name of a branch's exports: title, frame and method."""
    session, frame = branch.settings, branch.run.problem.frame
    title = re.sub(r"[^\w-]+", "_", session.title or session.scene.demo or "run").strip("_")[:40] or "run"
    return f"{title}_{frame.replace('/', '_')}_{session.method.name}"


def free(path: Path) -> Path:
    """Return ``path``, or the first of ``name-2``, ``name-3``, … that does not exist."""
    candidate, k = path, 2
    while candidate.exists():
        candidate = path.with_name(f"{path.stem}-{k}{path.suffix}")
        k += 1
    return candidate


def titled(session: Session, path: Path, space: Workspace) -> Session:
    """Return ``session`` with the title that it gets in the file ``path``.

    A file that was read or written here keeps its title, and so does a copy of it. A session
    that was changed since gets the name of its new file.
    """
    files = {file: saved.session for file, saved in space.files.items()}
    same = (there for there in files.values() if there == structs.replace(session, title=there.title))
    known = files.get(path.resolve()) or next(same, None)
    is_taken = any(there.title == session.title for there in files.values())
    title = known.title if known is not None else "" if is_taken else session.title
    return structs.replace(session, title=title or path.stem)


# What a file would lose


def _refuse_loss(path: Path, session: Session, branch: Branch, space: Workspace, verb: Save) -> None:
    """Pass where the file at ``path`` holds nothing that would be lost if ``session``, of ``branch``, replaced it.

    Raises:
        UnconfirmedError: it does.
    """
    what = "something that is no session"
    with suppress(VerefineError):
        what = _lost(load_session(path), space.files.get(path.resolve()), session, branch, space)
    if what:
        text = f"{path} holds {what}. Nothing was written: choose another name, or replace it."
        raise UnconfirmedError(text, "Replace it", structs.replace(verb, replace=True))


def _lost(there: Session, saved: Saved | None, session: Session, branch: Branch, space: Workspace) -> str:
    """Return what is lost of a file that holds ``there``; ``saved``: its content when it was read or written here."""
    if there == session:
        return ""
    if saved is None:
        return f"another session, “{there.title or 'untitled'}”"
    if there != saved.session:
        return "changes that were made since it was opened"
    n_edits = sum(edit not in session.edits for edit in there.edits)
    parts = [f"{n_edits} edited pose{'s' * (n_edits != 1)}"] if n_edits else []
    parts += ["settings changed on the way"] if any(one not in session.changes for one in there.changes) else []
    what = f"{' and '.join(parts)} that this branch does not have" if parts else ""
    other, elsewhere = saved.branch, space.others_of(branch)
    if other is None or other is branch or not (other in elsewhere or other.index in space.branches):
        return what
    if not what and other in elsewhere and structs.replace(there, edits=session.edits) == session:
        return ""  # Content about other frames is written again.
    return f"another branch, “{other.name}”" + (f", with {what}" if what else "")
