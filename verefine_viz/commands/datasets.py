"""``verefine-viz datasets``: the paper's data sets, how to get them, and whether a folder can be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from verefine_viz.core.errors import SettingsError


@dataclass(frozen=True)
class Datasets:
    """List the paper's data sets (datasets), look at a folder (datasets check DIR), or fetch (datasets fetch NAME)."""

    action: Annotated[Literal["list", "check", "fetch"], tyro.conf.Positional] = "list"
    """list: what there is and how to get it. check: which parts a folder has, what can be run, what is wrong; the
    exit code is 1 where a part needs a look (it is damaged, wrong, or nothing can be solved without it), else 0: that a
    copy holds only some frames of its targets file is a note. fetch: download from the BOP hub."""
    what: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="[DIR|NAME]")] = ""
    """check: the data set's folder. fetch: the data set's name."""
    folder: Path = Path("datasets")
    """fetch: where the archives go; each data set is a folder in it."""

    def run(self, arguments: Sequence[str]) -> int:
        if self.action == "list":
            return _list(self.folder)
        if not self.what:
            needed = "the folder to look at" if self.action == "check" else "the name of a data set"
            raise SettingsError(f"datasets {self.action} needs {needed}")
        return _check(Path(self.what)) if self.action == "check" else _fetch(self.what, self.folder)


def _list(folder: Path) -> int:
    from rich.console import Console
    from rich.markup import escape

    from verefine_viz.commands.dataset_catalogue import CATALOGUE, how_to_fetch

    console = Console(highlight=False, soft_wrap=True)
    for known in CATALOGUE:
        console.print(f"[bold]{known.name}[/]  {escape(known.title)}: {escape(known.used_for)}")
        for line in (*how_to_fetch(known, folder), *([known.note] if known.note else [])):
            console.print(f"      {escape(line)}")
    console.print("verefine-viz datasets fetch NAME downloads; datasets check DIR looks at what is there.")
    return 0


def _fetch(name: str, folder: Path) -> int:
    from verefine_viz.commands.dataset_catalogue import entry, fetch, how_to_fetch

    known = entry(name)
    for path in fetch(known, folder):
        print(path)
    print(how_to_fetch(known, folder)[-1])
    return 0


def _check(folder: Path) -> int:
    """0 where no part needs a look, else 1; the last line says so."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from verefine_viz.commands.dataset_check import check_split
    from verefine_viz.commands.dataset_parts import splits_of, what_can_be_run

    console = Console(highlight=False)
    looks: list[str] = []
    for split in splits_of(folder):
        with console.status(f"looking at {escape(split)}"):
            parts = check_split(folder, split)
        table = Table(title=escape(f"{folder.name} {split}"))
        for column in ("part", "", "found"):
            table.add_column(column, no_wrap=column != "found")
        for row in parts.findings:
            mark = "[yellow]look[/]" if row.advice else "[green]ok[/]" if row.is_looked_at else "–"
            table.add_row(escape(row.name), mark, escape(row.found + (f"\n→ {row.advice}" if row.advice else "")))
            looks += [row.name] * bool(row.advice)
        console.print(table)
        for what, missing in what_can_be_run(parts):
            console.print(
                escape(f"{'cannot' if missing else 'can'} run: {what}" + (f"; missing {missing}" * bool(missing))),
                soft_wrap=True,
            )
    if not looks:
        console.print("No part needs a look: exit code 0.")
        return 0
    how_many = "1 part needs" if len(looks) == 1 else f"{len(looks)} parts need"
    console.print(escape(f"{how_many} a look, hence exit code 1: {', '.join(looks)}."), soft_wrap=True)
    return 1
