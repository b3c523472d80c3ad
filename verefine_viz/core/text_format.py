"""Lists of names in one line, how many decimals a sentence needs, and what a terminal may be sent."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from itertools import accumulate
from typing import TextIO

LONGEST = 220
"""A list of names in a message is cut when it is longer [characters]."""
LONGEST_NUMBERS = 100
"""Longest line of numbers, which say less."""
MOST_NAMED = 6
"""Files or folders that a message names, where long paths would hide what it says."""


def listed(names: Iterable[object]) -> str:
    """Names in one line, numbers as "1-21, 30"; of more than a line takes the first ones, and how many there are."""
    names = list(names)
    numbers = [name for name in names if isinstance(name, int)]
    are_numbers = len(numbers) == len(names)
    texts, most = (_ranges(numbers), LONGEST_NUMBERS) if are_numbers else ([str(name) for name in names], LONGEST)
    whole = ", ".join(texts)
    if len(whole) <= most or len(texts) == 1:
        return whole or "none"
    n_shown = max(1, sum(end - 2 <= most for end in accumulate(len(text) + 2 for text in texts)))
    return f"{', '.join(texts[:n_shown])}, … ({len(names)} in all)"


def first_of(names: Sequence[object], most: int, between: str = ", ") -> str:
    """The first ``most`` names, and how many more there are, as in: ``a, b and 3 more``; "" of none.

    Sentences are separated by ``between = "; "``, the last one too.
    """
    shown = between.join(str(name) for name in names[:most])
    n_more = len(names) - most
    return f"{shown}{';' * (between == '; ')} and {n_more} more" if n_more > 0 else shown


def unusable(what: str, of: str, faults: Sequence[str]) -> tuple[str, ...]:
    """A note about entries of a file that cannot be used; empty where there are none.

    Args:
        what: an entry, as "row".
        of: the file's name.
        faults: what is wrong with each, the place in front.
    """
    if not faults:
        return ()
    n = len(faults)
    are = "cannot be used and is left out" if n == 1 else "cannot be used and are left out; the first"
    plural = f"{what[:-1]}ies" if what.endswith("y") else f"{what}s"
    return (f"{n} {what if n == 1 else plural} of {of} {are}: {faults[0]}",)


def _ranges(numbers: Iterable[int]) -> list[str]:
    """["1-21", "30", "31"] of 1, 2, …, 21, 30, 31: from four numbers on, those that follow each other are one."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return [text for run in runs for text in ([f"{run[0]}-{run[-1]}"] if len(run) > 3 else map(str, run))]


def distinguishing_digits(lead: float) -> int:
    """As many decimals as it takes to see that one of two numbers, or of two sums of two, is larger by ``lead`` ≥ 0.

    Two where that shows, or where six do not show it either.
    """
    return next((n for n in (2, 3, 4, 5) if lead >= 3 * 10.0**-n), 6 if lead >= 2e-6 else 2)


def plain(text: str) -> str:
    """The text as a terminal may be sent it: whatever it quotes from files, without codes; its lines stay."""
    return "".join(c if c.isprintable() or c in "\n\t" else "�" for c in text)


def say(text: object, to: TextIO | None = None) -> None:
    """Print a text to a terminal or a pipe, at once; the standard output unless another one is given."""
    print(plain(str(text)), file=sys.stdout if to is None else to, flush=True)
