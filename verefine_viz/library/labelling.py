"""Labels by a call: a rough pose of an object becomes one that is refined, rests on its support and is verified."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from numbers import Integral
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from verefine_viz.core.arguments import checked_text, described
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ArgumentTypeError, InputError, unknown
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed
from verefine_viz.labels.verification import labelled
from verefine_viz.library.frame_to_solve import AnyFrame, check_frame, target_of
from verefine_viz.library.single_calls import checked_poses
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.labels import Label
from verefine_viz.scenes.unlabelled_frames import Models, unlabelled_frames

if TYPE_CHECKING:
    from typing import Unpack

    from verefine_viz.library.sections import Sections

Named = Callable[[str | int], tuple[int, ObjectModel]]
"""The number and the model of an object, by its name or its number."""


def label(
    frame: AnyFrame,
    name: str | int,
    T_start: ArrayLike,
    others: Mapping[Any, ArrayLike] | None = None,
    **sections: Unpack[Sections],
) -> Label:
    """Label an object: refine a rough pose, settle it on its support and verify it, as "Snap" on the page does.

    Args:
        frame: the frame; masks and ground truth of its objects are not looked at. A folder's frame may lack both;
            where it lacks models: ``open_frame(path, scene={"source": "labels", "models": "meshes"})``.
        name: the object's name, or its instance_id; of an object that the frame does not list, its model's name or
            obj_id.
        T_start: (4, 4) the rough pose [m], within some 25° and 30 mm.
        others: poses (4, 4) of other objects of the frame, by name or number: the object cannot be where they are.
        sections: settings: ``method={"refiner": "icp"}``.

    Returns:
        ``pose`` (4, 4) [m], ``light`` (green, amber, red) with its ``reasons``, ``score``, ``fit_mm``, ``sinks_mm``,
        ``undetermined_mm`` and ``undetermined_deg``.

    Raises:
        InputError: there is no such object, or a pose is invalid.
        SettingsError: a setting is unknown or out of range.
    """
    check_frame(frame)
    if others is not None and not isinstance(others, Mapping):
        raise ArgumentTypeError(f"others is {described(others)}, expected {{name: pose}} of the objects beside it")
    tools, own = frame.tools(sections)
    observation, named = _opened(tools, own, name)
    proposed = Placed(*named(name), _one_pose(T_start, "T_start"))
    around = [Placed(*named(other), _one_pose(T, f"others[{other!r}]")) for other, T in (others or {}).items()]
    beside = [one for one in around if one.instance_id != proposed.instance_id]
    return labelled(tools, observation, proposed, beside, "given")


def _opened(tools: Toolbox, frame: str, name: str | int) -> tuple[Observation, Named]:
    """The frame with the objects that it lists; where the named one is missing, with all models of its folder."""
    try:
        problem = tools.source.problem(frame)
        target_of(problem, name)
    except InputError:
        if not tools.session.scene.dataset:
            raise
        bare = unlabelled_frames(tools.session.scene)
        return bare.observation(frame)[0], lambda name: _model(bare.models, name)

    def named(name: str | int) -> tuple[int, ObjectModel]:
        target = target_of(problem, name)
        return target.instance.instance_id, target.model

    return problem.observation, named


def _model(models: Models, name: str | int) -> tuple[int, ObjectModel]:
    if isinstance(name, Integral) and not isinstance(name, bool):
        return int(name), models.get(int(name))
    called = checked_text(name, "name", "an object's name, or its number")
    ids = {models.name(obj_id): obj_id for obj_id in reversed(models.ids)}
    if called not in ids:
        raise InputError(unknown("object", called, sorted(ids)))
    return ids[called], models.get(ids[called])


def _one_pose(given: ArrayLike, what: str) -> Float:
    poses = checked_poses(given)
    if len(poses) > 1:
        raise InputError(f"{what} is of {len(poses)} poses, expected one, (4, 4); call label for each")
    return poses[0]
