"""Small pictures of answers in notebooks: the photo around an object, with the contours of its answer."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable
from html import escape

from verefine_viz.core.errors import VerefineError
from verefine_viz.run.record import Answer

WIDTH_PX = 240
MOST_SHOWN = 12
"""The most answers of a run or batch that are shown with a picture."""
_STYLE = "display: inline-block; margin: 0 12px 12px 0; vertical-align: top; width: {width}px; font-size: 12px"
Draw = Callable[[Answer], bytes]
"""Draws an answer as WebP; empty bytes where that is impossible."""


class PicturedAnswer(Answer, frozen=True, eq=False, kw_only=True, dict=True):
    """An answer that a notebook shows with its picture."""

    def _repr_html_(self) -> str:
        return _figure(self, vars(self).get("draw"))


def pictured(answer: Answer, draw: Draw) -> PicturedAnswer:
    """The answer with the function that draws it once a notebook asks for it."""
    shown = PicturedAnswer(**{name: getattr(answer, name) for name in Answer.__struct_fields__})
    vars(shown)["draw"] = draw
    return shown


def gallery(title: str, answers: Iterable[PicturedAnswer]) -> str:
    """Answers side by side, as HTML."""
    every = tuple(answers)
    shown = "".join(one._repr_html_() for one in every[:MOST_SHOWN])
    more = f"<div>and {len(every) - MOST_SHOWN} more</div>" if len(every) > MOST_SHOWN else ""
    return f"<div><div>{escape(title)}</div>{shown}{more}</div>"


def _figure(answer: Answer, draw: Draw | None) -> str:
    try:
        image = b"" if draw is None else draw(answer)
    except VerefineError:  # The frame's images may be gone: the text is shown alone.
        image = b""
    url = f"data:image/webp;base64,{base64.b64encode(image).decode()}"
    picture = f'<img src="{url}" width="{WIDTH_PX}" alt="{escape(answer.name)}">' if image else ""
    words = escape(repr(answer).strip("<>"))
    return f'<div style="{_STYLE.format(width=WIDTH_PX)}">{picture}<div>{words}</div></div>'
