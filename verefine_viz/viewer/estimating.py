"""New first poses for one object of the open frame, and what the page says of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.scenes.estimates import asked_estimators
from verefine_viz.viewer.scene_now import labels_of

if TYPE_CHECKING:
    from verefine_viz.viewer.workspace import Workspace

SOURCES = {"results": "the results files", "perturb": "the disturbed ground truth"}
"""What the page calls where first poses come from; estimators have their names."""


def estimated(space: Workspace, instance_id: int, estimator: str) -> str:
    """Opens a branch whose first poses of one object come from ``estimator``, and says in words what that changes.

    Args:
        space: what is open.
        instance_id: of the object.
        estimator: its name; "session" = back to where the session's other first poses come from.

    Raises:
        VerefineError: the frame has no such instance, it has the session's poses already, or it cannot be read again;
            everything is as before.
        Cancelled: nobody waits for it any more; everything is as before.
    """
    labels = labels_of(space.work.problem)
    if instance_id not in labels:
        raise InputError(unknown("instance", instance_id, list(labels)))
    label, before, source = labels[instance_id], space.branch.name, source_of(space, instance_id)
    had = bool(space.work.problem.target(instance_id).instance.hypotheses)
    others, h = space.has_other_frames, space.branch.tools.session.hypotheses
    now = h.source if estimator == "session" else estimator
    if estimator == "session" and (space.frame, instance_id) not in asked_estimators(h):
        raise InputError(
            f"{label} in frame {space.frame} already has the session's first poses, {_of(now)}; to estimate others, "
            "choose ppf or pcs"
        )
    space.estimate(instance_id, estimator, f"{label} from {SOURCES.get(now, now)}")
    n = next(len(i.hypotheses) for i in space.work.problem.instances if i.instance_id == instance_id)
    said = f"{label} in frame {space.frame} now has {n} first pose{'s' if n != 1 else ''} {_of(now)}"
    if source != now and had:
        said += f", instead of those {_of(source)}"
    anew = ", but their runs begin anew" if others else ""
    return (
        f"{said}. Other objects and frames keep theirs{anew}. "
        f"The way back: the run before is still there as the branch “{before}”, in the table below."
    )


def _of(source: str) -> str:
    """As in: from the results files, by ppf."""
    return f"from {SOURCES[source]}" if source in SOURCES else f"by {source}"


def source_of(space: Workspace, instance_id: int) -> str:
    """Where the first poses of an object of the open branch come from."""
    h = space.branch.tools.session.hypotheses
    return asked_estimators(h).get((space.frame, instance_id), h.source)
