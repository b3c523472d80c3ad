"""``verefine-viz share``: a run as one HTML file that a colleague opens without installing anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from verefine_viz.core.errors import InputError
from verefine_viz.core.text_format import say
from verefine_viz.core.writing import check_file


@dataclass(frozen=True)
class ShareCommand:
    """Write a run as one HTML file that opens by a double click, offline and without this program."""

    what: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")] = None
    """A recorded run (.vfrun, .rrd), the folder of a batch or of traces, or a session, which is run to its end."""
    out: Path | None = None
    """The file; none = RUN.html in the working directory, with the batch before RUN and the frame after it."""
    frame: Annotated[str | None, tyro.conf.arg(metavar="SCENE/IMAGE")] = None
    """Which frame of a folder; none = the one with the worst answer of a batch, else the first."""
    maps: Literal["end", "marked", "all"] = "marked"
    """Iterations with score maps in the file. end: those that made the answers or that the verdict names. marked: also
    the marked ones (but switches of hypothesis) and the initial poses. all: every one."""
    scene: Annotated[bool, tyro.conf.arg(name="3d")] = True
    """Put the 3D view into the file, about 1 MB."""

    def run(self, arguments: Sequence[str]) -> int:
        from verefine_viz.core.console import Terminal
        from verefine_viz.page.share import share

        if self.what is None:
            raise InputError("missing from verefine-viz share: RUN; see verefine-viz share --help")
        what = self.what.resolve()
        stem = what.name if what.is_dir() else what.stem
        batch = f"{what.parent.parent.name}_" if what.is_file() and what.parent.name == "runs" else ""
        frame = f"_{self.frame.replace('/', '_')}" if self.frame else ""
        out = self.out or Path(f"{batch}{stem}{frame}.html")
        check_file(out, "run.html")
        with Terminal(stderr=True).status("Working out what the file shows"):
            note = share(self.what, out, self.frame, self.maps, with_scene=self.scene)
        say(f"{note}\n{out} ({out.stat().st_size / 1e6:.1f} MB)")
        return 0
