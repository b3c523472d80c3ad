"""``verefine-viz view``: the page in the browser."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from msgspec import structs

from verefine_viz.commands.flags import AnySettings, SessionFlags, given
from verefine_viz.core.errors import InputError, one_line
from verefine_viz.core.settings import BULLET, MethodSettings, Session
from verefine_viz.core.text_format import say

if TYPE_CHECKING:
    from verefine_viz.page.gallery import Gallery
    from verefine_viz.run.data_folder import KnownData


@dataclass(frozen=True)
class ViewCommand:
    """Open the page in the browser: step through a run and see why a pose won or lost."""

    session: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[SESSION|DIR|RUN]")] = None
    """A session file (.toml) or the name of a built-in one (mug, clutter, …), a recorded run (.vfrun, .rrd), or a
    folder: of batch runs, traces, kept frames, a data set in BOP layout or as another program has it, or poses for one
    near it (.csv, .npz, .yml); none = a built-in scene."""
    other: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[RUN_B]")] = None
    """A recorded run of the same frame, shown beside the first as B (A/B panel)."""
    host: str = "127.0.0.1"
    """Address to listen on. The page has no login: keep it on loopback and reach it from elsewhere by ssh -L."""
    port: int = 8080
    """Port to listen on; 0 = any free one."""
    allow_origin: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="URL")] = ()
    """Another address at which the page is reached (a tunnel whose near end has another port), or another page that may
    use it, such as http://localhost:3000. May be given several times."""
    open_browser: bool = True
    """Open the page in this desktop's browser, where there is one."""
    watch: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """A folder in which frames arrive, in BOP layout or from Frame.keep, or that holds several such: each is listed at
    once, solved in the background with the method of SESSION (none = of the folder's own session.toml), and can be
    opened."""
    out: Path | None = None
    """With --watch: folder for its results, those of a batch; none = FOLDER-runs beside it."""
    settings: AnySettings = field(default_factory=SessionFlags)

    def run(self, arguments: Sequence[str]) -> int:
        from verefine_viz.run.built_in_sessions import named_session

        named = None if self.session is None else named_session(self.session)
        if named != self.session:
            return replace(self, session=named).run(arguments)
        overrides = given(self.settings, arguments)
        if self.watch is not None:
            return self._run_watch(self.watch, overrides)
        if self.out is not None:
            raise InputError("--out is for the results of --watch FOLDER; leave it out, or name the folder to watch")
        recordings = _recordings(self.session, self.other, overrides)
        recording, _ = recordings
        batch: Gallery | None = None
        known: KnownData | None = None
        if recording is not None:
            session = _recorded_session(recording, self.other)
        elif known := _data_folder(self.session, overrides):
            say(f"{self.session}: {known.what}", sys.stderr)
            for note in known.notes:
                say(f"note: {one_line(note)}", sys.stderr)
            session = known.session
        elif self.session is not None and self.session.is_dir():
            from verefine_viz.batch.index import find_runs
            from verefine_viz.page.gallery import read_gallery
            from verefine_viz.run.session_parts import check_parts

            if note := find_runs(self.session).note:
                say(note, sys.stderr)
            batch = read_gallery(self.session, overrides)
            for missing in batch.notes:
                say(f"note: {missing}", sys.stderr)
            session = batch.session(batch.worst.run)
            check_parts(session, f"run {batch.worst.run}", "open", f"view {self.session}")
        else:
            _check_kind(self.session)
            from verefine_viz.run.session_file import load_session

            session = load_session(self.session, overrides)
        path = None if batch or recording or known else self.session
        return self.serve(session, session_path=path, recordings=recordings, batch=batch)

    def serve(
        self,
        session: Session,
        recordings: tuple[Path | None, Path | None] = (None, None),
        batch: Gallery | None = None,
        **shown: Any,
    ) -> int:
        from verefine_viz.page.app import serve
        from verefine_viz.page.protocol import Compare
        from verefine_viz.run.kernels_ahead import compile_ahead

        compile_ahead(session)
        a, b = recordings
        serve(
            session,
            host=self.host,
            port=self.port,
            allowed_origins=self.allow_origin,
            open_browser=self.open_browser and _has_desktop(),
            gallery=batch,
            recording=a,
            first=[Compare(a=0, recording=str(b), run=False)] if b is not None else [],
            **shown,
        )
        return 0

    def _run_watch(self, folder: Path, overrides: Mapping[str, Any]) -> int:
        if self.other is not None or (self.session is not None and self.session.suffix != ".toml"):
            wrong = self.session if self.other is None else self.other
            raise InputError(f"{wrong} is no session; with --watch expected a session file (.toml) or none")
        from verefine_viz.batch.index import is_batch_folder
        from verefine_viz.batch.watch import Watch, data_folders
        from verefine_viz.run.session_file import DURING_A_RUN, load_session
        from verefine_viz.run.session_parts import check_names

        if is_batch_folder(folder) and not data_folders(folder):
            raise InputError(
                f"{folder} holds runs, which are not watched: verefine-viz view {folder} shows them; expected a folder "
                "in which frames arrive"
            )
        base = load_session(self.session, overrides) if self.session is not None else None
        by_options = {section: given for section, given in overrides.items() if section in DURING_A_RUN}
        settings = base or load_session(None, by_options)
        check_names(settings)
        beside = folder.resolve()
        out = self.out if self.out is not None else beside.with_name(f"{beside.name}-runs")
        return self.serve(settings, watch=Watch(folder, out, base, overrides))


def _data_folder(path: Path | None, overrides: Mapping[str, Any]) -> KnownData | None:
    """The data at a path; None where the path holds a batch, a recording or a session.

    Raises:
        InputError: the path is a folder that cannot be opened.
    """
    from verefine_viz.batch.index import is_batch_folder, named_runs
    from verefine_viz.run.data_folder import data_at, layout_fault

    if path is None or is_batch_folder(path):
        return None
    known = data_at(path, overrides)
    if known is None and path.is_dir() and not named_runs(path) and not (path / "session.toml").exists():
        why = layout_fault(path)
        batch = "is no folder of a batch: it has no run.json, and " if why.startswith("holds no data") else ""
        raise InputError(f"{path} {batch}{why}")
    return known


def _is_recording(path: Path | None) -> bool:
    """Whether a path is that of a recorded run."""
    return path is not None and path.suffix in (".rrd", ".vfrun")


def _check_kind(path: Path | None) -> None:
    """Raise InputError where the path does not exist, or cannot be opened."""
    if path is not None and path.suffix != ".toml":
        why = "cannot be opened" if path.exists() else "does not exist"
        expected = "a session (.toml), the folder of a batch run, or a recorded run (.vfrun, .rrd)"
        raise InputError(f"{path} {why}; expected {expected}")


def _recordings(a: Path | None, b: Path | None, overrides: Mapping[str, Any]) -> tuple[Path | None, Path | None]:
    """The recordings A and B, None where A is none.

    Raises:
        InputError: B is no recording, or settings are given for A, a recording.
    """
    if b is not None and not _is_recording(b):
        raise InputError(
            f"{b} is no recording; expected a second file (.vfrun, .rrd) of the same frame, or none{_hint(a, b)}"
        )
    if _is_recording(a) and overrides:
        raise InputError(f"{a} is a recording, whose settings are fixed; leave out the options, or open its session")
    return a if _is_recording(a) else None, b


def _hint(a: Path | None, b: Path) -> str:
    """A hint for folders of runs in place of recordings."""
    if not b.is_dir():
        return ""
    from verefine_viz.batch.index import is_batch_folder, named_runs

    parents = [path for path in (a, b) if path is not None and not is_batch_folder(path)]
    below = "".join(f"; runs in {path}: {runs}" for path in parents if (runs := named_runs(path)))
    return f". Two runs are compared by verefine-viz report RUN_A RUN_B, several are shown by view FOLDER{below}"


def _recorded_session(path: Path, other: Path | None) -> Session:
    """A session with the frame of a recording, on which the page opens before it shows the recording itself.

    Method, simulator and source of initial poses are left out, as showing a recording does not need the parts that it
    was made with.

    Raises:
        InputError: one of the recordings cannot be read, or the other is of another frame.
    """
    from verefine_viz.page.workspace import check_same_frame
    from verefine_viz.recording.reader import read_recording
    from verefine_viz.run.run_header import session_of

    header = read_recording(path).header
    session = session_of(header)
    if other is not None:  # Checked before the user is sent to a page that cannot open.
        theirs = read_recording(other).header
        check_same_frame(other, (session_of(theirs), theirs.frame), (session, header.frame))
    scene = structs.replace(session.scene, frames=(header.frame,))
    method = MethodSettings(name="refine", refiner="identity")
    physics = structs.replace(session.physics, simulator=BULLET)
    hypotheses = structs.replace(session.hypotheses, source="perturb", estimate=())
    return structs.replace(
        session, scene=scene, method=method, physics=physics, hypotheses=hypotheses, edits=(), changes=()
    )


def _has_desktop() -> bool:
    """Whether a browser window can be opened here (a text browser would take over the terminal)."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
