"""A table as one prints it: on the terminal, in Markdown, and in LaTeX."""

from __future__ import annotations

import re
from dataclasses import dataclass

from rich import box
from rich.markup import escape
from rich.table import Table

MATH = {"VF_b": "VF$_b$", "VF_d": "VF$_d$", "r̄": r"$\bar{r}$", "t̄": r"$\bar{t}$"}
"""Names that are set as formulas, in LaTeX and in figures."""
TEX = MATH | {"&": r"\&", "%": r"\%", "#": r"\#", "°": r"$^\circ$", "–": "--", "<": "$<$", "_": r"\_"}
"""What LaTeX spells otherwise; longer keys stand before those that they contain."""


@dataclass(frozen=True)
class PrintedTable:
    """Words and numbers as they are printed, row by row; the first column names the row."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    best: frozenset[tuple[int, int]] = frozenset()
    """(row, column) of what is printed bold."""
    rules: tuple[int, ...] = ()
    """Rows above which there is a rule."""
    note: str = ""
    """What the numbers are; below the table."""

    def terminal(self) -> Table:
        """The table for a console."""
        table = Table(title=escape(self.title), caption=escape(self.note), box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
        table.title_justify = table.caption_justify = "left"
        for k, heading in enumerate(self.headings):
            table.add_column(escape(heading), justify="right" if k else "left", no_wrap=True)
        for r, row in enumerate(self.rows):
            cells = (f"[bold]{escape(c)}[/bold]" if (r, k) in self.best else escape(c) for k, c in enumerate(row))
            table.add_row(*cells, end_section=r + 1 in self.rules)
        return table

    def markdown(self) -> str:
        """The table in Markdown, its title as a heading."""
        rule = ("---", *("---:" for _ in self.headings[1:]))
        rows = (
            tuple(f"**{c}**" if (r, k) in self.best else c for k, c in enumerate(row))
            for r, row in enumerate(self.rows)
        )
        lines = (f"| {' | '.join(cells)} |" for cells in (self.headings, rule, *rows))
        return "\n".join([f"## {self.title}", "", *lines, *(("", self.note) if self.note else ())])

    def latex(self) -> str:
        """The table as a LaTeX float, with the rules of the package booktabs."""
        caption = " ".join(f"{_tex(text)}." for text in (self.title, self.note.removesuffix(".")) if text)
        lines = [r"\begin{table}", r"  \centering", rf"  \caption{{{caption}}}"]
        lines += [rf"  \begin{{tabular}}{{l{'r' * (len(self.headings) - 1)}}}", r"    \toprule"]
        lines += [f"    {' & '.join(map(_tex, self.headings))} \\\\", r"    \midrule"]
        for r, row in enumerate(self.rows):
            if r in self.rules:
                lines.append(r"    \midrule")
            cells = (rf"\textbf{{{_tex(c)}}}" if (r, k) in self.best else _tex(c) for k, c in enumerate(row))
            lines.append(f"    {' & '.join(cells)} \\\\")
        return "\n".join([*lines, r"    \bottomrule", r"  \end{tabular}", r"\end{table}"])


def _tex(text: str) -> str:
    return re.sub("|".join(map(re.escape, TEX)), lambda word: TEX[word.group()], text)


def with_formulas(text: str) -> str:
    """The text with its formulas set, for a figure."""
    return re.sub("|".join(MATH), lambda word: MATH[word.group()], text)
