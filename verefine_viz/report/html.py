"""Templates into one HTML file: what the report of a run and the comparison of many have in common."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import plotly.graph_objects as go
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from verefine_viz.batch.rows import ObjectRow
from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS, difference_scale
from verefine_viz.diagnosis.causes import cause_title
from verefine_viz.pictures.answer_pictures import color_of
from verefine_viz.pictures.landscape_picture import curve_svg
from verefine_viz.report import charts
from verefine_viz.report import run_sentences as words
from verefine_viz.report.failure_cards import Failure, Gallery
from verefine_viz.report.object_results import Share
from verefine_viz.report.run_results import Key, key


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
    return environment.get_template(template).render(plotly=Markup(get_plotlyjs()), **context)


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
    return {
        "failures": failures,
        "failures_sentence": words.failures_sentence(len(cards), failures.n_more, has_truth),
        "cards": [_card(card, anchors, (by_object or {}).get(key(card.row), {})) for card in cards],
        "card_of": _card_of(anchors),
        "filter_groups": list(dict.fromkeys(card.pick.group for card in cards if card.pick.group)),
        "filter_causes": sorted({cause for card in cards for cause in card.causes}),
        "filter_objects": sorted({card.row.name for card in cards if card.row.name}),
        "contours": _contours(both),
        "unknown_color": charts.css(CLASS_COLORS["unknown"]),
        "scale_gradient": scale.gradient(),
        "scale_ticks": [tick.replace("-", "−") for tick in scale.ticks],
    }


@dataclass(frozen=True)
class Card:
    """One failure as gallery.html shows it."""

    failure: Failure
    anchor: str
    """Its place on the page."""
    curve: Markup | None
    around: Markup
    """The score around the answer, as two small drawings; empty where it is unknown."""
    elsewhere: tuple[tuple[str, Share, str | None], ...]
    """Where groups are compared: how often each gets this object right, and where its card is, if it has one."""


def _card(card: Failure, anchors: Mapping[tuple[str, Key], str], shares: Mapping[str, Share]) -> Card:
    curve = charts.curve_figure(card.curve, card.row.worst_iteration) if card.curve else None
    elsewhere = tuple((name, share, anchors.get((name, key(card.row)))) for name, share in shares.items())
    around = Markup("".join(curve_svg(one, 170, 64) for one in card.around or ()))
    return Card(card, anchors[card.pick.place], figure_json(curve) if curve else None, around, elsewhere)


def _card_of(anchors: Mapping[tuple[str, Key], str]) -> Callable[[ObjectRow], str | None]:
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
