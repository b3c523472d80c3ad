"""The page within a notebook: served on a free loopback port by the kernel, and closed with it."""

from __future__ import annotations

import atexit
import tempfile
from html import escape
from pathlib import Path
from typing import Any

from verefine_viz.core.errors import InputError
from verefine_viz.core.paths import at_home
from verefine_viz.core.settings import Session
from verefine_viz.page.app import App
from verefine_viz.page.what_lies_at import what_lies_at
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_file import SUFFIX, RunFile

HEIGHT_PX = 800


class ShownPage:
    """A page that a notebook shows; it ends with :meth:`close`, or with the kernel.

    Args:
        app: serves it.
        height: of the frame in the notebook [px].
        folder: holds what it opens, and goes with it; None = the user's own files.
    """

    def __init__(self, app: App, height: int, folder: tempfile.TemporaryDirectory | None = None) -> None:
        self._app, self._height, self._folder = app, height, folder
        atexit.register(self.close)

    @property
    def url(self) -> str:
        """The address, for a browser on this machine."""
        return self._app.url

    def close(self) -> None:
        """End the page and free its port; closing it again does nothing."""
        atexit.unregister(self.close)
        self._app.stop()
        if self._folder is not None:
            self._folder.cleanup()

    def __repr__(self) -> str:
        return f"the page at {self.url}"

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {self._height}px; border: 0"
        return f'<iframe src="{escape(self.url)}" style="{style}" allow="clipboard-write; fullscreen"></iframe>'


def show(what: Any, height: int = HEIGHT_PX) -> ShownPage:
    """Show a run, or what lies at a path, within a notebook.

    Args:
        what: a record of a run, an object whose ``record()`` gives one, or the path of a recorded run (``.vfrun``,
            ``.rrd``), of a session (``.toml``), or of a folder of a batch or of data.
        height: of the frame in the notebook [px].

    Raises:
        VerefineError: it cannot be opened.
    """
    record = what if isinstance(what, RunRecord) else what.record() if hasattr(what, "record") else None
    folder = None
    if record is not None:
        folder = tempfile.TemporaryDirectory(prefix="verefine-viz-")
        path = write_record(record, Path(folder.name) / f"run{SUFFIX}")
    elif isinstance(what, str | Path):
        path = at_home(str(what))
    else:
        raise InputError(f"{type(what).__name__} cannot be shown; expected a run, its record, or the path of one")
    found = what_lies_at(path)
    app = App(
        session=found.session, session_path=found.session_path, port=0, gallery=found.gallery, recording=found.recording
    ).start()
    page = ShownPage(app, height, folder)
    try:
        app.wait_until_ready()
    except BaseException:
        page.close()
        raise
    return page


def write_record(record: RunRecord, path: Path) -> Path:
    """Write a record as a run file and return its path."""
    file = RunFile(path, Session())
    file.begin(record.header)
    for iteration in record.iterations:
        file.append(iteration)
    if record.end is not None:
        file.finish(record.end)
    file.close()
    return path
