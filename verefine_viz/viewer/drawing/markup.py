"""HTML for the panels: escaped text, tables, and links that carry a command.

The GUI library shows HTML as it is, so everything that comes from data goes through :func:`text` first. A link holds a
command as JSON; ``assets/page.js`` puts it into a hidden text field, which is how it reaches Python. Only commands of
:mod:`verefine_viz.viewer.commands` get through there.
"""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from itertools import groupby
from typing import TYPE_CHECKING, Any

from verefine_viz.core.palette import RGB
from verefine_viz.core.problem import Target
from verefine_viz.viewer.command_json import to_json
from verefine_viz.viewer.commands import Command
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import (
    arm_color,
    has_several_sources,
    in_focus,
    source_of,
    stem_and_number,
    without_common_start,
)

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


def text(value: object) -> str:
    """Anything as text that HTML cannot misread."""
    return html.escape(str(value), quote=True)


def block(content: str, css_class: str = "") -> str:
    """The whole content of one HTML widget."""
    return f'<div class="vz {css_class}">{content}</div>'


def carries(command: Command) -> str:
    """Attributes that make an element send ``command`` when it is clicked."""
    return f'data-cmd="{text(to_json(command))}"'


def double_click(command: Command) -> str:
    """Attributes with which a pane sends ``command`` when its head is clicked twice."""
    return f'data-double="{text(to_json(command))}"'


def link(label: str, command: Command, title: str = "") -> str:
    """Text to click; ``label`` is escaped here."""
    return f'<a {carries(command)} title="{text(title)}">{text(label)}</a>'


def swatch(color: RGB, title: str = "") -> str:
    """A small square in a colour that means something."""
    return f'<i class="sw" style="background:rgb{color}" title="{text(title)}"></i>'


def table(head: Sequence[tuple[str, str]], rows: Sequence[Row]) -> str:
    """A table: ``head`` holds (label, tooltip) per column."""
    titles = "".join(f'<th title="{text(tip)}">{text(label)}</th>' for label, tip in head)
    return f"<table><thead><tr>{titles}</tr></thead><tbody>{''.join(r.html for r in rows)}</tbody></table>"


class Row:
    """One row: cells are ready HTML; ``command`` makes the whole row a link; ``marked`` makes it stand out; ``parted``
    draws a line above it.
    """

    def __init__(
        self, cells: Sequence[str], command: Command | None = None, marked: bool = False, parted: bool = False
    ) -> None:
        attributes = carries(command) if command else ""
        name = " ".join(["marked"] * marked + ["parted"] * parted)
        self.html = f'<tr class="{name}" {attributes}>{"".join(f"<td>{c}</td>" for c in cells)}</tr>'


Column = tuple[str, str, Callable[[Any], str]]
"""A column of :func:`table_of`: label, tooltip, and the cell of one item as ready HTML."""


def table_of(
    items: Iterable[Any],
    columns: Sequence[Column],
    command: Callable[[Any], Command | None] = lambda _: None,
    marked: Callable[[Any], bool] = lambda _: False,
) -> str:
    """A table with a row per item; ``command``: what a click on its row sends; ``marked``: which rows stand out."""
    rows = [Row([cell(item) for _, _, cell in columns], command(item), marked(item)) for item in items]
    return table([(label, tip) for label, tip, _ in columns], rows)


def sentence(content: str, hints: Mapping[str, str] | None = None) -> str:
    """The words at the top of a panel, escaped here; ``hints`` as in :func:`with_hints`."""
    return f'<p class="say">{with_hints(content, hints or {})}</p>' if content else ""


def with_hints(content: str, hints: Mapping[str, str]) -> str:
    """Words that are escaped here, the first of each of the ``hints`` with its tooltip."""
    shown = text(content)
    for word, hint in hints.items():
        match = re.search(rf"\b{re.escape(text(word))}\b", shown, re.IGNORECASE)
        if match:
            term = f'<span class="term" title="{text(hint)}">{match[0]}</span>'
            shown = shown[: match.start()] + term + shown[match.end() :]
    return shown


def small(content: str, title: str = "") -> str:
    """A small faint line, as below a table; escaped here."""
    return f'<p class="legend dim" title="{text(title)}">{text(content)}</p>' if content else ""


def warning(content: str, extra: str = "", red: bool = False, folded: bool = False) -> str:
    """A box with something to act on; ``extra`` is ready HTML, such as a link. ``folded``: one line until a click."""
    name = "bad" if red else "warn"
    if folded:
        return f'<p class="{name} fold folded" title="{text(content)}">{text(content)} {extra}</p>'
    return f'<p class="{name}">{text(content)} {extra}</p>'


NONE = "–"
"""What stands where there is no number."""


def number(value: float | None, digits: int, unit: str = "") -> str:
    """A number with its unit, or a dash."""
    return NONE if value is None else f"{value:.{digits}f}{unit}"


# Names that may be longer than their place: cut where they tell least, whole in their tooltips.


LONG, TAIL = 14, 5
"""Characters of a name that is cut in its middle, and of the end that stays."""


def cut(name: str, most_px: int = 104) -> str:
    """At most so wide [px] on the screen."""
    stem, number = stem_and_number(name)
    classes = "cut numbered" if number or len(name) > LONG else "cut"
    return f'<span class="{classes}" style="max-width:{most_px}px" title="{text(name)}">{_html(stem, number)}</span>'


def fitted(name: str, before: str = "") -> str:
    """As wide as its place; ``before`` is ready HTML in front of it."""
    stem, number = stem_and_number(name)
    if not number and len(name) <= LONG:
        return f'{before}<span title="{text(name)}">{text(name)}</span>'
    return f'<span class="numbered" title="{text(name)}">{before}{_html(stem, number)}</span>'


def focus_label(snapshot: Snapshot) -> str:
    """The colour of the object in focus, its name as tooltip; empty where there is one object, or all are shown."""
    if len(snapshot.scene.objects) < 2 or snapshot.is_whole_scene:
        return ""
    o = in_focus(snapshot)
    return swatch(o.color, o.label)


def _html(stem: str, number: str) -> str:
    if number:
        return f"<span>{text(stem)}</span>&nbsp;{text(number)}"
    # Names that differ at their end alone still differ.
    return f"<span>{text(stem[:-TAIL])}</span>{text(stem[-TAIL:])}" if len(stem) > LONG else text(stem)


# Hypotheses as the page shows them: number, colour, and where each comes from.


def arms_legend(target: Target, brief: bool = False) -> str:
    """A swatch per hypothesis, and behind those of one source its name; "all …" where there is but one.

    ``brief``: without the words that all names begin with, and without one that all have.
    """
    numbered = enumerate(target.instance.hypotheses)
    groups = [(source, [j for j, _ in group]) for source, group in groupby(numbered, lambda pair: source_of(pair[1]))]
    every = "" if has_several_sources(target) or len(target.instance.hypotheses) < 2 else "all "
    names = [source for source, _ in groups]
    if brief and len(names) == 1:
        tip = text(f"all {names[0]}")
        return f'<span title="{tip}">{" ".join(f"{swatch(arm_color(j))}{j + 1}" for j in groups[0][1])}</span>'
    return " ".join(
        f'<span style="white-space:nowrap" title="{text(source)}">'
        f"{' '.join(f'{swatch(arm_color(j))}{j + 1}' for j in group)} "
        f'<span class="cut" style="max-width:290px">{every}{text(name)}</span></span>'
        for (source, group), name in zip(groups, without_common_start(names) if brief else names, strict=True)
    )


# A list of commands to choose from, small enough to stand three in a row.


def choice(title: str, options: Sequence[tuple[str, Command]], now: Command) -> str:
    """A drop-down list of (label, command); ``title`` is its tooltip, ``now`` what holds."""
    items = "".join(
        f'<option value="{text(to_json(command))}"{" selected" if command == now else ""}>{text(label)}</option>'
        for label, command in options
    )
    name = text(title)
    return f'<select aria-label="{name}" title="{name}">{items}</select>'


# HTML from the templates in ``viewer/templates``: text is escaped there, ready HTML is marked as such here.


def filled(template: str, **context: Any) -> str:
    """A template with the values that it names."""
    return _environment().get_template(template).render(context)


def ready(html: str) -> Markup:
    """HTML that a template is not to escape."""
    from markupsafe import Markup

    return Markup(html)


@lru_cache(maxsize=1)
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # The page starts without it.

    environment = Environment(
        loader=PackageLoader("verefine_viz.viewer"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.globals["swatch"] = lambda color: ready(swatch(color))
    return environment
