"""An answer that counts as wrong only by a turn that its model does not declare."""

from __future__ import annotations

from dataclasses import dataclass

from verefine_viz.core.causes import Cause
from verefine_viz.core.finding import Finding
from verefine_viz.core.model import TEXTURE
from verefine_viz.diagnosis.number_words import instead


@dataclass(frozen=True)
class UndeclaredTurn:
    """An estimate that is right but for a turn after which the object has the same shape."""

    turn_deg: float
    error: float
    """Error of the estimate, as a share of the diameter."""
    error_with_symmetry: float
    """The error if the model declared that turn."""
    colors_differ: float | None = None
    """Difference of the model's colours after the turn, in [0, 1]; None where it has no colours."""

    @property
    def texture_tells(self) -> bool:
        """Whether the colours of the model differ after the turn."""
        return self.colors_differ is not None and self.colors_differ >= TEXTURE

    def describe(self, name: str) -> str:
        """What the turn means for the answer of the object ``name``."""
        return (
            f"The {name} has the same shape when turned by {self.turn_deg:.0f}°, but its model declares no such "
            "symmetry, so that the turn counts as an error: with it declared, "
            f"{instead(self.error_with_symmetry, self.error)}.{self._texture_note()}"
        )

    def finding(self, name: str) -> Finding:
        """Say that the turn alone makes the answer of the object ``name`` count as wrong."""
        return Finding(
            Cause.SYMMETRIC,
            self.describe(name),
            {"turn_deg": self.turn_deg, "error": self.error, "error_with_symmetry": self.error_with_symmetry},
            True,
            detail=f": turned by {self.turn_deg:.0f}°",
        )

    def _texture_note(self) -> str:
        if self.colors_differ is None:
            return " Whether texture could tell is not known: the model has no colours."
        if not self.texture_tells:
            return " Its colours are alike as well."
        return " Its texture could tell, as colours differ there; depth cannot."
