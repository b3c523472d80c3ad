"""Templates into one HTML file: what the report of a run and the comparison of many have in common."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import plotly.graph_objects as go
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from verefine_viz.batch.answer_cards import (
    Values,
    bar_html,
    entry_html,
    gallery_asset,
    number_of,
    places_of,
    values_of,
)
from verefine_viz.batch.index import ORDERS, Order
from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS, difference_scale
from verefine_viz.diagnosis.causes import cause_title
from verefine_viz.pictures.answer_pictures import color_of
from verefine_viz.pictures.landscape_picture import curve_svg
from verefine_viz.report import charts
from verefine_viz.report import run_sentences as words
from verefine_viz.report.failure_cards import Failure, Gallery
from verefine_viz.report.object_results import Share
from verefine_viz.report.run_results import Key, key
from verefine_viz.run.record import Answer


def filled(template: str, context: Mapping[str, Any]) -> str:
    """A template's page, as one HTML document that loads nothing from elsewhere."""
    environment = Environment(
        loader=PackageLoader("verefine_viz.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {
        "percent": words.percent,
        "number": words.number,
        "signed": words.signed,
        "tone": words.tone,
        "cause": cause_title,
        "breakable": breakable,
    }
    assets = {name.replace(".", "_"): Markup(gallery_asset(name)) for name in ("gallery.css", "gallery.js")}
    return environment.get_template(template).render(plotly=Markup(get_plotlyjs()), **assets, **context)


def breakable(name: str) -> Markup:
    """A name that a narrow column may break after an underline or a dot, but not within a number."""
    return Markup(re.sub(r"(_|\.(?!\d))", r"\1<wbr>", str(escape(name))))


def figure_json(figure: go.Figure) -> Markup:
    """A chart as the page draws it."""
    # In a script element only "</" could end it; no JSON needs a bare "<".
    return Markup((figure.to_json() or "{}").replace("<", "\\u003c"))


def gallery_context(
    failures: Gallery,
    has_truth: bool,
    tau_m: float,
    both: bool = False,
    by_object: Mapping[Key, Mapping[str, Share]] | None = None,
) -> dict[str, Any]:
    """What gallery.html needs.

    Args:
        failures: the cards.
        has_truth: whether anything can be right or wrong.
        tau_m: depth tolerance of the score [m].
        both: whether two runs are shown beside each other.
        by_object: how often each group gets each object right, where groups are compared.
    """
    cards, scale = failures.failures, difference_scale(tau_m)
    anchors = {card.pick.place: f"card-{k}" for k, card in enumerate(cards, start=1)}
    values = [_values(card) for card in cards]
    places = places_of([card.row for card in cards])
    orders: list[Order] = [order for order in ORDERS if has_truth or order not in ("error", "misleading")]
    return {
        "failures": failures,
        "failures_sentence": words.failures_sentence(len(cards), failures.n_more, has_truth),
        "cards": [_card(k, card, anchors, (by_object or {}).get(key(card.row), {})) for k, card in enumerate(cards)],
        "card_of": _card_of(anchors),
        "gallery_bar": bar_html(values, orders),
        "entry": lambda card, more: _entry(card, values[card.place], places[card.place], more),
        "contours": _contours(both),
        "unknown_color": charts.css(CLASS_COLORS["unknown"]),
        "scale_gradient": scale.gradient(),
        "scale_ticks": [tick.replace("-", "−") for tick in scale.ticks],
    }


@dataclass(frozen=True)
class Card:
    """One failure as gallery.html shows it."""

    place: int
    """In the list of failures."""
    failure: Failure
    anchor: str
    """Its id on the page."""
    curve: Markup | None
    around: Markup
    """The score around the answer, as two small drawings; empty where it is unknown."""
    elsewhere: tuple[tuple[str, Share, str | None], ...]
    """Where groups are compared: how often each gets this object right, and where its card is, if it has one."""


def _values(card: Failure) -> dict[str, Sequence[str]]:
    """What a card has for each filter; of two runs, the causes of both."""
    causes, pick = [cause_title(cause) for cause in card.causes], card.pick
    return values_of(
        card.row, **({"cause": causes} if causes else {}), **({"group": (pick.group,)} if pick.group else {})
    )


def _entry(card: Card, values: Values, places: Mapping[Order, int], more: str) -> Markup:
    failure, row, other = card.failure, card.failure.row, card.failure.other
    number = ""
    if other is not None and failure.pick.other is not None:
        number = f"{failure.pick.run.label} {number_of(row)} · {failure.pick.other.label} {number_of(other)}"
    return entry_html(
        row,
        card.anchor,
        values,
        places,
        picture=failure.pictures.camera if failure.pictures else "",
        number=number,
        tags=failure.tags,
        anchor=card.anchor,
        more=more,
    )


def _card(place: int, card: Failure, anchors: Mapping[tuple[str, Key], str], shares: Mapping[str, Share]) -> Card:
    curve = charts.curve_figure(card.curve, card.row.worst_iteration) if card.curve else None
    elsewhere = tuple((name, share, anchors.get((name, key(card.row)))) for name, share in shares.items())
    around = Markup("".join(curve_svg(one, 170, 64) for one in card.around or ()))
    return Card(place, card, anchors[card.pick.place], figure_json(curve) if curve else None, around, elsewhere)


def _card_of(anchors: Mapping[tuple[str, Key], str]) -> Callable[[Answer], str | None]:
    """Where the page shows an object, in the card of its worst answer; None where it has no card."""
    first: dict[Key, str] = {}
    for (_, place), anchor in anchors.items():
        first.setdefault(place, anchor)
    return lambda row: first.get(key(row))


def _contours(both: bool) -> list[tuple[str, str]]:
    named = [("answer of A", "A"), ("answer of B", "B")] if both else [("answer", "best")]
    return [(name, charts.css(color_of(kind))) for name, kind in named] + [
        ("ground truth", charts.css(STAGE_COLORS["ground truth"]))
    ]
