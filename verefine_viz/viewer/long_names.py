"""Names that may be longer than their place: cut where they tell least, whole in their tooltips."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.viewer.markup import text

_CHARACTER_PX = 6.2


def cut(name: str, most_px: int = 104) -> str:
    """At most so wide [px] on the screen."""
    stem, number = _parted(name)
    classes = "cut numbered" if number else "cut"
    return f'<span class="{classes}" style="max-width:{most_px}px" title="{text(name)}">{_html(stem, number)}</span>'


def fitted(name: str, before: str = "") -> str:
    """As wide as its place; ``before`` is ready HTML in front of it."""
    stem, number = _parted(name)
    if not number:
        return f'{before}<span title="{text(name)}">{text(name)}</span>'
    return f'<span class="numbered" title="{text(name)}">{before}{_html(stem, number)}</span>'


def shortened(name: str, room_px: float) -> str:
    """As much of a name as there is room for, in plain text; a number that tells twins apart stays."""
    n = int((room_px - 5) / _CHARACTER_PX)
    if len(name) <= n:
        return name
    number = _parted(name)[1]
    kept = n - 1 - len(number)
    return f"{name[:kept]}…{number}" if kept > 2 else f"{name[: max(n - 1, 1)]}…"


def told_apart(names: Sequence[str]) -> list[str]:
    """Names without the words that all begin with: cut at their end, they would look the same."""
    words = [name.split() for name in names]
    n = 0
    while len(names) > 1 and all(len(w) > n + 1 for w in words) and len({w[n] for w in words}) == 1:
        n += 1
    return [f"…{' '.join(w[n:])}" for w in words] if n else list(names)


def _parted(name: str) -> tuple[str, str]:
    """A name, and the number behind it that tells twins apart; "" where there is none."""
    stem, sign, number = name.rpartition(" #")
    return (stem, f"#{number}") if sign else (name, "")


def _html(stem: str, number: str) -> str:
    return f"<span>{text(stem)}</span>&nbsp;{text(number)}" if number else text(stem)
