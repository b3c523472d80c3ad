"""A gallery of answers, alike on the page and in the report: one card, one bar above it, one style and one script.

The script (``templates/gallery.js``) searches, filters and sorts in the browser, by what :func:`entry_html` writes into
each card; :func:`matches` is the same in Python.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from verefine_viz.batch.index import ORDERS, Order, sort_key
from verefine_viz.diagnosis.causes import cause_title
from verefine_viz.run.record import WAITING, Answer

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

WRONG = "wrong or no answer"
RIGHT = "right"
FILTERS = {"result": "Result", "cause": "Cause", "object": "Object", "method": "Method", "run": "Run", "group": "Group"}
"""What a gallery can be filtered by, besides tags, and its words."""
NO_ANSWER = {"no_answer": "no answer", "left_out": "left out", "failed": "frame failed"}
Values = Mapping[str, Sequence[str]]
"""What an answer has for each filter; several where two runs are compared."""


def values_of(row: Answer, **more: Sequence[str]) -> dict[str, Sequence[str]]:
    """What an answer has for each filter; ``more``: run, group, or other values than the row's own."""
    is_wrong = not row.is_waiting and (row.status != "ok" or row.is_correct is False)
    result = WRONG if is_wrong else RIGHT if row.is_correct else WAITING if row.is_waiting else "unknown"
    own = {"result": result, "cause": cause_title(row.cause), "object": row.name, "method": row.method}
    return {by: (value,) for by, value in own.items() if value} | more


def words_of(row: Answer, values: Values) -> str:
    """What is searched, in small letters; tags come to it."""
    known = [row.frame, row.name, row.message, row.evidence, *(word for some in values.values() for word in some)]
    return " ".join(dict.fromkeys(filter(None, known))).lower()


def places_of(rows: Sequence[Answer]) -> list[dict[Order, int]]:
    """By row: where it comes in each order."""
    out: list[dict[Order, int]] = [{} for _ in rows]
    for order in ORDERS:
        place = sort_key(order)
        for k, i in enumerate(sorted(range(len(rows)), key=lambda i: place(rows[i]))):
            out[i][order] = k
    return out


def choices_of(values: Sequence[Values]) -> list[tuple[str, str, list[str]]]:
    """Filter, its words and its values, for each that leaves a choice."""
    out = []
    for by, label in FILTERS.items():
        options = sorted({value for one in values for value in one.get(by, ())})
        if len(options) > 1 or (by == "cause" and options):
            out.append((by, label, options))
    return out


def number_of(row: Answer) -> str:
    """How wrong an answer is, or its score where that is unknown."""
    if row.is_waiting:
        return "waiting"
    if row.status != "ok":
        return NO_ANSWER[row.status]
    if row.add_s_mm is not None:
        return f"{row.add_s_mm:.1f} mm"
    return "–" if row.score is None else f"score {row.score:.2f}"


def cause_of(row: Answer) -> str:
    """Why, in a few words: the cause, or why there is no answer."""
    return cause_title(row.cause) if row.cause else row.message if row.status != "ok" else ""


def entry_html(
    row: Answer,
    key: str,
    values: Values,
    places: Mapping[Order, int],
    *,
    picture: str | None = None,
    number: str = "",
    made_by: str = "",
    tags: Sequence[str] = (),
    tip: str = "",
    command: str = "",
    anchor: str = "",
    more: str = "",
) -> Markup:
    """One answer.

    Args:
        row: the answer.
        key: what the script and the program call it.
        values: as of :func:`values_of`.
        places: as of :func:`places_of`.
        picture: a data URI; "" = there is none, None = it is fetched when it comes into sight.
        number: instead of :func:`number_of`, and of the score beside it.
        made_by: method, run or group.
        tags: of the user's.
        tip: tooltip.
        command: what opens it, as JSON; "" = it cannot be opened.
        anchor: its id on the page.
        more: ready HTML behind the card.
    """
    return _filled(
        "answer_card.html",
        row=row, key=key, values=json.dumps(values), places=json.dumps(places), words=words_of(row, values),
        tags=json.dumps(tags), picture=picture, number=number or number_of(row),
        cause=cause_of(row), score="" if row.score is None or row.add_s_mm is None or number else f"{row.score:.2f}",
        is_right=False if row.status != "ok" and not row.is_waiting else row.is_correct,
        made_by=made_by, tip=tip, command=command, anchor=anchor, more=_ready(more),
    )  # fmt: skip


def bar_html(values: Sequence[Values], orders: Sequence[Order] = tuple(ORDERS), has_tags: bool = False) -> Markup:
    """What stands above a gallery; ``has_tags``: whether answers can be tagged and filters saved here."""
    shown = {order: ORDERS[order] for order in orders}
    return _filled("gallery_bar.html", filters=choices_of(values), orders=shown, has_tags=has_tags)


def gallery_asset(name: str) -> str:
    """The text of ``gallery.css`` or ``gallery.js``."""
    return (resources.files("verefine_viz.batch") / "templates" / name).read_text(encoding="utf-8")


def _filled(template: str, **context: Any) -> Markup:
    return _ready(_environment().get_template(template).render(context))


def _ready(html: str) -> Markup:
    from markupsafe import Markup

    return Markup(html)


@lru_cache(maxsize=1)
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # A batch runs without it.

    return Environment(
        loader=PackageLoader("verefine_viz.batch"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
