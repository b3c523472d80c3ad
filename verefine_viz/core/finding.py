"""Findings: reasons why an answer is wrong, missing or in doubt, as run files hold them."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct, field
from msgspec.structs import force_setattr

from verefine_viz.core.remedies import SettingValue
from verefine_viz.core.setting_types import Index


class Finding(Struct, frozen=True, omit_defaults=True):
    """One reason why an answer is wrong, missing or in doubt."""

    cause: str
    """The :class:`~verefine_viz.core.causes.Cause`; "" where only the text is known."""
    text: str
    """What happened, in a sentence with numbers and units."""
    numbers: Mapping[str, float] = field(default_factory=dict)
    """The evidence. Names carry their unit; errors are ADD(-S) as a share of the diameter."""
    is_confirmed: bool = False
    """Whether it alone explains the failure: a re-run without it came out right, or nothing else explains it."""
    rests_on: str = ""
    """The re-run that came out right; empty where none was needed."""
    iteration: Index | None = None
    """Iteration that shows it; 0 = before the first, None = none in particular."""
    try_: Mapping[str, SettingValue] | None = None
    """Settings that may help, such as ``method.exploration``."""
    short: str = ""
    """The text in a few words, for one line; empty where the title of the cause says it."""
    detail: str = ""
    """A number to append to ``title`` where there is room."""

    @property
    def title(self) -> str:
        """What happened, in a few words for one line."""
        from verefine_viz.core.causes import cause_title  # Texts that records and run files do without.

        return self.short or cause_title(self.cause)

    def __post_init__(self) -> None:
        # Numbers of numpy cannot be written to a file.
        force_setattr(self, "numbers", {name: float(number) for name, number in self.numbers.items()})
