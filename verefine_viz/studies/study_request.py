"""Which study is asked for."""

from __future__ import annotations

from dataclasses import dataclass

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.studies.ablation import ablation, robustness
from verefine_viz.studies.grasping_study import grasping
from verefine_viz.studies.paper_tables import tables
from verefine_viz.studies.study_plan import Study

STUDIES = ("ablation", "robustness", "tables", "grasping")


@dataclass(frozen=True)
class StudyRequest:
    """Which study; small and plain, so that every worker can build the same."""

    name: str
    quick: bool = False
    own_initial_poses: bool = False
    """The tables start from the session's own initial poses instead of disturbed ground truth."""
    refiner: str = "icp"
    """The session's; the tables have it besides the paper's."""

    def study(self) -> Study:
        """
        Raises:
            SettingsError: there is no study of this name.
        """
        if self.name == "ablation":
            return ablation(self.quick, self.refiner)
        if self.name == "robustness":
            return robustness(self.quick, self.refiner)
        if self.name == "tables":
            return tables(self.own_initial_poses, self.refiner)
        if self.name == "grasping":
            return grasping(self.quick, self.own_initial_poses, self.refiner)
        raise SettingsError(unknown("study", self.name, STUDIES))
