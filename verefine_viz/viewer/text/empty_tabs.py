"""Which tabs have nothing to show, and why: what the method, the frame or this moment does not produce."""

from __future__ import annotations

from verefine_viz.methods.registry import method_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot

NO_GROUND_TRUTH = "No ground truth for this object."


def empty_tabs(snapshot: Snapshot) -> dict[str, str]:
    """By the tab's name, why it is empty; tabs that show something are not in it."""
    why = {
        "Bandit": _no_bandit(snapshot),
        "Landscape": no_landscape(snapshot),
        "Grasp": no_grasp(snapshot),
        "Errors": NO_GROUND_TRUTH if snapshot.ground_truth is None else "",
        "Order": no_order(snapshot),
        "UCB": "" if _has_bounds(snapshot) else "Nothing is chosen by a bound here.",
        "Error": NO_GROUND_TRUTH if all(o.target.instance.T_cam_obj_gt is None for o in snapshot.scene.objects) else "",
    }
    return {tab: words for tab, words in why.items() if words}


def _no_bandit(snapshot: Snapshot) -> str:
    method = method_of(snapshot.session.method.name)
    if method.first_only:
        return f"{method.label} works on one hypothesis: nothing to choose."
    return "" if snapshot.state is not None or snapshot.is_whole_scene else "There is no hypothesis to choose from."


def _has_bounds(snapshot: Snapshot) -> bool:
    return method_of(snapshot.session.method.name).has_ucb and not snapshot.is_whole_scene


def no_landscape(snapshot: Snapshot) -> str:
    """Why there is no score around the answer; "" where there is, or it is being worked out."""
    if snapshot.is_whole_scene:
        return "Choose an object: the score around its answer is shown here."
    if "best" not in snapshot.poses:
        return "No pose yet."
    return "" if snapshot.landscape is not None or snapshot.wants_landscape else "Shown when the run is over."


def no_grasp(snapshot: Snapshot) -> str:
    """Why nothing can be grasped; "" where it can."""
    observation = snapshot.problem.observation
    if observation.support is None:
        return f"No support plane: {observation.support_note or 'none was found'}."
    if any(i.T_cam_obj_gt is None for i in snapshot.problem.instances):
        return "A simulated grasp needs the ground truth of all objects."
    if snapshot.is_whole_scene:
        return "Choose an object to grasp."
    return "" if snapshot.T_cam_obj_grasped is not None else "No pose yet."


def no_order(snapshot: Snapshot) -> str:
    """Why there is no order of objects."""
    if len(snapshot.scene.objects) < 2:
        return "One object: nothing to order."
    return "No dependencies known." if snapshot.problem.dependencies is None else ""
