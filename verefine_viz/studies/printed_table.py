"""Tables in Markdown and in LaTeX."""

from __future__ import annotations

import re

from verefine_viz.core.console import PrintedTable

MATH = {"VF_b": "VF$_b$", "VF_d": "VF$_d$", "r̄": r"$\bar{r}$", "t̄": r"$\bar{t}$"}
"""Names that are set as formulas, in LaTeX and in figures."""
TEX = MATH | {"&": r"\&", "%": r"\%", "#": r"\#", "°": r"$^\circ$", "–": "--", "<": "$<$", "_": r"\_"}
"""Replacements for LaTeX; longer keys come before those that they contain."""


def markdown(table: PrintedTable) -> str:
    """The table in Markdown, its title as a heading."""
    rule = ("---", *("---:" for _ in table.headings[1:]))
    rows = (
        tuple(f"**{c}**" if (r, k) in table.styles else c for k, c in enumerate(row))
        for r, row in enumerate(table.rows)
    )
    lines = (f"| {' | '.join(cells)} |" for cells in (table.headings, rule, *rows))
    return "\n".join([f"## {table.title}", "", *lines, *(("", table.note) if table.note else ())])


def latex(table: PrintedTable) -> str:
    """The table as a LaTeX float, with the rules of the package booktabs."""
    caption = " ".join(f"{_tex(text)}." for text in (table.title, table.note.removesuffix(".")) if text)
    lines = [r"\begin{table}", r"  \centering", rf"  \caption{{{caption}}}"]
    lines += [rf"  \begin{{tabular}}{{l{'r' * (len(table.headings) - 1)}}}", r"    \toprule"]
    lines += [f"    {' & '.join(map(_tex, table.headings))} \\\\", r"    \midrule"]
    for r, row in enumerate(table.rows):
        if r in table.rules:
            lines.append(r"    \midrule")
        cells = (rf"\textbf{{{_tex(c)}}}" if (r, k) in table.styles else _tex(c) for k, c in enumerate(row))
        lines.append(f"    {' & '.join(cells)} \\\\")
    return "\n".join([*lines, r"    \bottomrule", r"  \end{tabular}", r"\end{table}"])


def _tex(text: str) -> str:
    return re.sub("|".join(map(re.escape, TEX)), lambda word: TEX[word.group()], text)


def with_formulas(text: str) -> str:
    """The text with its formulas set, for a figure."""
    return re.sub("|".join(MATH), lambda word: MATH[word.group()], text)
