"""What the user has chosen to see. Nothing here changes what is computed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from verefine_viz.batch.answer_tags import Arrangement
from verefine_viz.core.arrays import Float
from verefine_viz.core.records import Iteration
from verefine_viz.core.scores import MapName
from verefine_viz.run.engine import Run
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.grasp_commands import GraspedBy

STAGES: tuple[str, ...] = (
    "initial", "current", "simulated", "mixed", "refined", "flipped", "accepted", "best", "runner-up", "edited",
    "ground truth",
)  # fmt: skip
"""Every pose of an object that can be drawn, compared and scored."""


def stage_label(name: str) -> str:
    """What the page calls a stage; others, and what a scene is called, as they are."""
    return "answer" if name == "best" else name


LAYERS: tuple[str, ...] = (
    *STAGES, "hypotheses", "cloud", "camera image", "plane", "gravity", "contacts", "others", "overlaps",
    "path",
)  # fmt: skip
SHOWN_AT_FIRST = frozenset(
    {"current", "simulated", "refined", "flipped", "accepted", "edited", "ground truth"}
    | {"hypotheses", "cloud", "camera image", "plane", "gravity", "contacts", "others", "overlaps"}
)


@dataclass(frozen=True)
class ViewOptions:
    """The state of every display switch."""

    focus: int | None = None
    """instance_id whose numbers are shown; None = the one that the iteration at the cursor worked on."""
    whole_scene: bool = False
    """Whether panels show the scene instead of one object."""
    arm: int | None = None
    """Hypothesis whose history is shown; None = the one at work."""
    stage: str | None = None
    """Last stage of the iteration that is revealed; None = all of them."""
    a: str = "simulated"
    b: str = "refined"
    has_chosen: bool = False
    """Whether the user has chosen what is compared; else the end of a run shows its answer against ground truth."""
    map: MapName = "classes"
    refiner_crops: bool = False
    """Whether what a learned refiner saw is shown instead of the score maps."""
    pixel: tuple[int, int] | None = None
    """(u, v) that is probed."""
    ruler: tuple[int, int] | None = None
    """(u, v) from which the ruler reaches to the probed pixel."""
    cut_percent: int = 0
    """How much of the diameter of the object in focus is cut off in 3D."""
    cloud: c.CloudColors = "colour"
    layers: frozenset[str] = SHOWN_AT_FIRST
    preset: c.Preset = "inspect"
    enlarged: c.Pane | None = None
    """What alone is in the middle of the page, instead of what the preset has there."""
    hypotheses_with_answer: bool = False
    """Whether the layer of hypotheses is drawn with the answer as well, which it would hide."""
    path_pose: int | None = None
    """Index into the simulated path that is drawn; None = not drawn."""
    grasp_by: GraspedBy = "pose"
    """Whose grasp is shown."""
    grasp_moment: int | None = None
    """Of the grasp that is drawn; None = not drawn."""
    animate: bool = True
    edited: c.Pose | None = None
    """T_cam_obj of the gizmo; None = nothing is edited."""
    edited_from: c.Pose | None = None
    """T_cam_obj of the pose with which the editing began."""
    compared_before: tuple[str, str] | None = None
    """What was compared before a pose was edited; None where the user has chosen since."""
    landscape_wanted: bool = False
    """Whether the score around the best pose is asked for before the run is over."""
    curves_of: Literal["table", "object"] = "table"
    """Whose axes the landscape's curves are along."""
    slice_axes: tuple[int, int] = (5, 0)
    """Numbers of the heat map's two axes, across and up: at first turn about the vertical, shift to the right."""
    arrangement: Arrangement = field(default_factory=Arrangement)
    """Which of a batch's answers are listed, and in which order."""
    arranged_by: str = ""
    """The browser in which that was chosen."""

    @property
    def T_cam_obj_edited(self) -> Float | None:
        """The edited pose as a matrix (4, 4)."""
        return None if self.edited is None else np.array(self.edited).reshape(4, 4)

    @property
    def T_cam_obj_edited_from(self) -> Float | None:
        """The pose with which the editing began as a matrix (4, 4)."""
        return None if self.edited_from is None else np.array(self.edited_from).reshape(4, 4)

    @property
    def is_moved(self) -> bool:
        """Whether the edited pose is elsewhere than it was; what a browser's rounding makes of it is not [m, 1]."""
        T, T_from = self.T_cam_obj_edited, self.T_cam_obj_edited_from
        return T is not None and T_from is not None and not np.allclose(T, T_from, rtol=0, atol=1e-5)

    def moved(self) -> ViewOptions:
        """The same after the cursor moved: what belonged to the iteration is dropped, the object in focus is not."""
        return replace(self.unedited(), arm=None, stage=None, path_pose=None, landscape_wanted=False)

    def editing(self, edited: c.Pose, arm: int) -> ViewOptions:
        """The same with a pose of a hypothesis being edited, beside the accepted one."""
        before = (self.a, self.b) if self.edited is None else self.compared_before
        layers = self.layers | {"edited", "accepted"}
        return replace(
            self, edited=edited, edited_from=edited, arm=arm, a="accepted", b="edited", compared_before=before,
            layers=layers,
        )  # fmt: skip

    def unedited(self) -> ViewOptions:
        """The same without an edited pose, or a grasp: compared is what was compared before."""
        a, b = self.compared_before or (self.a, self.b)
        return replace(
            self, edited=None, edited_from=None, a=a, b=b, compared_before=None, grasp_by="pose", grasp_moment=None
        )

    def afresh(self) -> ViewOptions:
        """The same for another frame or another run: what was chosen for good stays."""
        return ViewOptions(
            cloud=self.cloud, layers=self.layers, map=self.map, refiner_crops=self.refiner_crops, animate=self.animate,
            arrangement=self.arrangement, arranged_by=self.arranged_by, preset=self.preset, enlarged=self.enlarged,
            curves_of=self.curves_of, slice_axes=self.slice_axes, cut_percent=self.cut_percent,
        )  # fmt: skip


# How much of the iteration at the cursor is shown: all of it, up to a stage, or instead of it the run's answer


def is_partial(run: Run, options: ViewOptions) -> bool:
    """Whether the iteration at the cursor is shown up to a stage before its last one."""
    return run.iteration is not None and options.stage in [stage.name for stage in run.iteration.stages[:-1]]


def revealed(iteration: Iteration, stage: str | None) -> tuple[str, ...]:
    """The stages of an iteration up to ``stage``; all of them for None or where it has no such stage."""
    names = tuple(s.name for s in iteration.stages)
    return names[: names.index(stage) + 1] if stage in names else names


# The end of a finished run shows its answer. What was tried last belongs to the last iteration, and can be asked for:
# the answer is shown unless a stage, a simulated path or an edited pose is shown.

AGAINST: tuple[tuple[str, str], ...] = (("best", "ground truth"), ("best", "runner-up"))
"""What is compared by itself where the answer is wrong, and where nothing says whether it is."""

OF_ITERATION = frozenset({"current", "simulated", "mixed", "refined", "flipped", "accepted"})
"""Poses that an iteration goes through."""


def is_answer(run: Run, options: ViewOptions) -> bool:
    """Whether the answer is shown."""
    beside = options.stage is None and options.path_pose is None and options.edited is None
    return run.at_end and run.length > 0 and beside


def answered(options: ViewOptions) -> ViewOptions:
    """``options`` where the answer is shown: without poses of the iteration.

    What is compared is the user's choice, else the answer with its start.
    """
    a, b = options.a, options.b
    if b in OF_ITERATION:
        a, b = "initial" if a == "best" else a, "best"
    if a in OF_ITERATION:
        a = "best" if b != "best" else "initial"
    layers = options.layers - OF_ITERATION | {"best"}
    return replace(options, a=a, b=b, layers=layers if options.hypotheses_with_answer else layers - {"hypotheses"})
