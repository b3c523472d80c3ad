"""``verefine-viz evaluate`` on a made-up data set."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.cli.command_line import CommandLine
from tests.scenes.bop_folder import OBJ_IDS, Made
from verefine_viz import cli
from verefine_viz.scenes.results_csv import ResultRow


@dataclass(frozen=True)
class BadInput(CommandLine):
    """A data set, a perfect results file, and what the command prints."""

    results: Path

    def run(self, *words: object) -> str:
        """Standard output of a run that ends well."""
        code = cli.main(["evaluate", *map(str, words or [self.results]), "--dataset", str(self.made.root)])
        captured = self.capsys.readouterr()
        assert code == 0, captured.err
        return captured.out

    def json(self, *words: object) -> dict[str, Any]:
        return json.loads(self.run(*(words or [self.results]), "--json"))

    def refused(self, *words: object) -> str:
        """The one line with which a run is refused."""
        arguments = [*map(str, words or [self.results])]
        if "--dataset" not in arguments:
            arguments += ["--dataset", str(self.made.root)]
        return super().refused("evaluate", *arguments)


def rows(made: Made, time_s: float = 0.25, im_id: int = 3) -> list[ResultRow]:
    return [ResultRow(7, im_id, obj_id, 0.5, T, time_s) for obj_id, T in zip(OBJ_IDS, made.truth, strict=True)]
