"""What cases of bad input at the command line work with."""

from __future__ import annotations

import json
from pathlib import Path

from tests.cli.command_line import CommandLine
from verefine_viz.batch.folder import RunFolder
from verefine_viz.run.session_file import resolve


class BadInput(CommandLine):
    """Sessions on a made-up data set, and batches of them."""

    def refused(self, *words: object, leaves: tuple[str, ...] = ()) -> str:
        """The one line with which these words are refused; they write nothing but what ``leaves`` names."""
        before = {*self.folder.rglob("*")}
        line = super().refused(*words)
        assert {path.relative_to(self.folder).parts[0] for path in {*self.folder.rglob("*")} - before} <= {*leaves}
        return line

    def bop(self, scene: str = "", hypotheses: str = "") -> Path:
        """A session on the made-up data set."""
        text = f'[scene]\nsource = "bop"\ndataset = {json.dumps(str(self.made.root))}\n{scene}\n'
        return self.file("session.toml", f"{text}[hypotheses]\n{hypotheses}\n")

    def results(self, row: str) -> Path:
        """A session on the made-up data set whose initial poses are a results file of one row."""
        self.file("r.csv", f"{row}\n")
        return self.bop(hypotheses='source = "results"\nfiles = ["r.csv"]')

    def evaluate(self, *words: object) -> tuple[object, ...]:
        """How ``evaluate`` is called on the data set."""
        return ("evaluate", *words, "--dataset", self.made.root)

    def batch_folder(self) -> Path:
        """The folder of a batch that lacks its tables."""
        folder = RunFolder(self.folder / "run", resolve({}))
        folder.write_json("run.json", {"status": "finished"})
        folder.close()
        return self.folder / "run"
