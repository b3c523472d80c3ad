"""The page within a notebook: served on a free loopback port by the kernel, and closed with it."""

from __future__ import annotations

import atexit
import tempfile
from html import escape
from pathlib import Path
from typing import Any

from verefine_viz.core.arguments import checked_count
from verefine_viz.page.app import App
from verefine_viz.page.openable import path_of, read_openable

HEIGHT_PX = 800


class ShownPage:
    """A page that a notebook shows; it ends with :meth:`close`, or with the kernel.

    Args:
        app: serves it.
        height: of the frame in the notebook [px].
        folder: goes with it.
    """

    def __init__(self, app: App, height: int, folder: tempfile.TemporaryDirectory) -> None:
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
        self._folder.cleanup()

    def __repr__(self) -> str:
        return f"the page at {self.url}"

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {self._height}px; border: 0"
        return f'<iframe src="{escape(self.url)}" style="{style}" allow="clipboard-write; fullscreen"></iframe>'


def show(what: Any, height: int = HEIGHT_PX) -> ShownPage:
    """Show a run, or what lies at a path, within a notebook.

    Args:
        what: a run, its record, or the path of a recorded run (``.vfrun``,
            ``.rrd``), of a session (``.toml``), or of a folder of a batch or of data.
        height: height of the page in the notebook [px].

    Returns:
        The page; a notebook shows it, ``url`` is its address, ``close()`` ends it.

    Raises:
        VerefineError: it cannot be opened.
    """
    height = checked_count(height, "height", 50, 10_000)
    folder = tempfile.TemporaryDirectory(prefix="verefine-viz-")
    try:
        there = read_openable(path_of(what, Path(folder.name)))
        app = App(
            session=there.session,
            session_path=there.session_path,
            port=0,
            gallery=there.gallery,
            recording=there.recording,
        ).start()
    except BaseException:
        folder.cleanup()
        raise
    page = ShownPage(app, height, folder)
    try:
        app.wait_until_ready()
    except BaseException:
        page.close()
        raise
    return page
