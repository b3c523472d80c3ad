"""What frames of a batch note, each once: a note of an object is the same whatever its number in a frame."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

MOST = 20
"""Different notes that are told; nobody reads more."""
_NUMBER = re.compile(r" \(#\d+\)")
"""Behind an object's name: another in each frame, and nothing in a table of many."""


class Notes:
    """Counts in how many places something is noted.

    Args:
        most: different notes that are kept; the first ones.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._often: Counter[str] = Counter()
        self._shown: dict[str, str] = {}

    def add(self, notes: Iterable[str]) -> None:
        """Takes those of one place."""
        by_kind: dict[str, str] = {}
        for note in notes:
            kind = _NUMBER.sub("", note)
            by_kind[kind] = note if by_kind.get(kind, note) == note else kind
        for kind, note in by_kind.items():
            if kind not in self._often and len(self._often) >= self._most:
                continue
            self._often[kind] += 1
            self._shown[kind] = note if self._shown.get(kind, note) == note else kind

    def counted(self) -> dict[str, int]:
        """The notes and how many places have them; the number of an object stays where it is always the same."""
        return {self._shown[kind]: n for kind, n in self._often.most_common()}
