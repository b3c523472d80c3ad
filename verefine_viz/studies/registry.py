"""The studies by name."""

from __future__ import annotations

from dataclasses import dataclass

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.studies.ablation import ablation
from verefine_viz.studies.robustness import robustness
from verefine_viz.studies.study import Study
from verefine_viz.studies.tables import tables

STUDIES = ("ablation", "robustness", "tables")


@dataclass(frozen=True)
class Wanted:
    """Which study; small and plain, so that every worker can build the same."""

    name: str
    quick: bool = False
    keep_pools: bool = False

    def study(self) -> Study:
        """The study.

        Raises:
            SettingsError: there is none of this name.
        """
        if self.name == "ablation":
            return ablation(self.quick)
        if self.name == "robustness":
            return robustness(self.quick)
        if self.name == "tables":
            return tables(self.quick, self.keep_pools)
        raise SettingsError(unknown("study", self.name, STUDIES))
