"""``verefine-viz film``: a run in four to six pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.core.errors import InputError
from verefine_viz.core.text_format import say
from verefine_viz.core.writing import check_file

ENDINGS = (".png", ".gif")


@dataclass(frozen=True)
class FilmCommand:
    """Tell how an answer came about, and what is wrong with it, in four to six pictures: a strip (PNG) or an animation
    (GIF). A recorded run is not run again.
    """

    what: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")] = None
    """A recorded run (.vfrun, .rrd), the folder of a batch or of traces, or a session, which is run to its end."""
    out: Path = Path("film.png")
    """The file to write: .png for a strip of all pictures, .gif for one picture after the other."""
    frame: Annotated[str | None, tyro.conf.arg(metavar="SCENE/IMAGE")] = None
    """Which frame of a folder; none = the one with the worst answer of a batch, else the first."""
    instance: int | None = None
    """Which object, by its number in the frame, from 0; none = the worst."""

    def run(self, arguments: Sequence[str]) -> int:
        if self.what is None:
            raise InputError("missing from verefine-viz film: RUN; see verefine-viz film --help")
        if self.out.suffix.lower() not in ENDINGS:
            raise InputError(f"--out is {self.out.name}, expected a name that ends in .png or .gif")
        check_file(self.out, "film.png")
        from verefine_viz.core.console import Terminal
        from verefine_viz.page.film_file import write_film
        from verefine_viz.page.share import opened
        from verefine_viz.run.built_in_sessions import named_session

        with Terminal(stderr=True).status("Working out what the film shows"):
            debugger = opened(named_session(self.what).resolve(), self.frame)
            for _ in debugger.work_out(None if self.instance is None else (self.instance,)):
                pass
            note = write_film(debugger, self.out, instance=self.instance)
        say(f"{note}\n{self.out} ({self.out.stat().st_size / 1e3:.0f} kB)")
        return 0
