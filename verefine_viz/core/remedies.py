"""Remedies: changes of settings that may keep a cause from doing harm, with their names in tables and commands."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from verefine_viz.core.settings import Session

SettingValue = bool | float | str


@dataclass(frozen=True)
class Remedy:
    """A change of one setting: to a value, to a weight of at least some value, or to a multiple of the present one."""

    setting: str
    """Dotted name of the setting."""
    to: SettingValue | None = None
    """New value; None = a multiple of the present one."""
    times: float = 1.0
    times_number: str = ""
    """Name of the finding's number that gives the factor; without that number it is :attr:`times`."""
    at_least: float = 0.0
    """Least value that a multiple may give."""

    def for_finding(self, numbers: Mapping[str, float]) -> Remedy:
        """The remedy with its factor from the numbers of a finding."""
        return Remedy(self.setting, self.to, numbers.get(self.times_number, self.times), "", self.at_least)

    @property
    def name(self) -> str:
        """Name of the remedy: ``physics.enabled = false``, ``method.iterations x2``."""
        if self.to is None:
            return f"{self.setting} x{self.times:g}"
        return f"{self.setting} = {self.to if isinstance(self.to, str) else json.dumps(self.to)}"

    def changes(self, session: Session) -> dict[str, SettingValue]:
        """The setting's new value by dotted name; empty where the session has it already."""
        section, _, field = self.setting.partition(".")
        now = getattr(getattr(session, section), field)
        value = max(now, self.to) if isinstance(self.to, float) else self.to
        if value is None:
            value = max(self.times * now, self.at_least)
            value = round(value) if isinstance(now, int) else value
        return {} if value == now else {self.setting: value}


MORE_EXPLORATION = Remedy("method.exploration", times=2, at_least=0.05)
MORE_ITERATIONS = Remedy("method.iterations", times=2, times_number="times")
MORE_EXPANSIONS = Remedy("mcts.expansions", times=2, times_number="times")
MORE_HYPOTHESES = Remedy("hypotheses.max_per_object", times=2)
FOUND_HYPOTHESES = Remedy("hypotheses.source", "ppf")
MILLIMETRES = Remedy("data.pose_times", times_number="factor")
COLOUR = Remedy("score.colour_weight", 0.1)
PLAUSIBLE = Remedy("score.plausibility_weight", 0.1)
CONVEX_PARTS = Remedy("physics.collider", "decomposition")
NO_PHYSICS = Remedy("physics.enabled", to=False)
GIVEN_GRAVITY = Remedy("scene.gravity", "world")
BY_ICP = Remedy("method.refiner", "icp")
BY_NETWORK = Remedy("method.refiner", "depth_net_icp")
