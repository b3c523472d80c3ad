"""Commands about the simulated grasp of the object in focus."""

from __future__ import annotations

from typing import Literal

from verefine_viz.viewer.commands import Command, ViewCommand

GraspedBy = Literal["pose", "ground truth"]
"""Whose grasp: that of the answer so far or of the edited pose, or that of the ground truth."""


class TryGrasp(Command):
    """Carries out the best free grasp of the object in focus, by its pose and by its ground truth."""

    is_long = keeps_edited_pose = keeps_b_running = True


class ShowGrasp(ViewCommand):
    """A moment of a grasp that was carried out; None = hide it, or the moment as before where ``by`` is given."""

    latest_wins = True
    moment: int | None = None
    by: GraspedBy | None = None


class PlayGrasp(Command):
    """Shows the grasp moment by moment."""

    keeps_edited_pose = keeps_b_running = True
