"""``verefine-viz label``: ground truth for frames that have none."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.commands.flags import AnySettings, SessionFlags, given
from verefine_viz.commands.view import ViewCommand
from verefine_viz.core.errors import InputError, one_line
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import say
from verefine_viz.core.writing import check_folder


@dataclass(frozen=True)
class LabelCommand:
    """Label the objects of your own frames: place a model by a click, or have it searched for in a box; the program
    refines it, settles it on its support, and says what is verified and what is undetermined.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Frames: a data set in BOP layout, a split or a scene of it, traces, or a folder as another program has it; ground
    truth, masks and models may be missing."""
    models: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """Folder of the meshes to place (PLY, OBJ, GLB, STL), named as the objects, or the models of a BOP data set; none =
    those of DIR."""
    out: Path | None = None
    """Folder of labels.json, where the labels are; none = DIR, or DIR-labels where DIR cannot be written to."""
    write: bool = False
    """Write the accepted labels as ground truth and end, without the page: into DIR, where that is a data set in BOP
    layout without any, or into --to."""
    to: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """With --write: a data set of its own, with the images and models."""
    uncertain: bool = False
    """With --write: uncertain labels, too."""
    overwrite: bool = False
    """With --write: move ground truth that is there aside."""
    host: str = "127.0.0.1"
    """Another address at which the page is reached, as for view."""
    port: int = 8080
    """Port to listen on; 0 = any free one."""
    open_browser: bool = True
    """Open the page in this desktop's browser, where there is one."""
    settings: AnySettings = field(default_factory=SessionFlags)

    def run(self, arguments: Sequence[str]) -> int:
        from verefine_viz.run.label_session import label_session

        session = label_session(self.folder, self.models, self._labels(), given(self.settings, arguments))
        if self.write:
            return self._written(session)
        if self.to is not None or self.uncertain or self.overwrite:
            raise InputError("--to, --uncertain and --overwrite are for --write, which writes labels as ground truth")
        page = ViewCommand(host=self.host, port=self.port, open_browser=self.open_browser)
        return page.serve(session)

    def _labels(self) -> Path | None:
        """The folder of labels.json; None where the frames are in no folder, which is reported when they are opened."""
        from verefine_viz.labels.label_folder import folder_of_labels

        if self.out is not None:
            check_folder(self.out)
            return self.out
        return folder_of_labels(self.folder) if self.folder.is_dir() else None

    def _written(self, session: Session) -> int:
        from verefine_viz.labels.desk import LabelDesk
        from verefine_viz.run.toolbox import Toolbox

        desk = LabelDesk(Toolbox(session))
        try:
            written = desk.export(self.to, self.uncertain, (), self.overwrite)
        finally:
            desk.close()
        for note in written.notes:
            say(f"note: {one_line(note)}", sys.stderr)
        say(f"{written.n_objects} labels of {written.n_frames} frames written to {written.folder}")
        return 0
