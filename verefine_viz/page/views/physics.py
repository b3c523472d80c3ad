"""Whether the objects can stand where they are, and what the simulation did: answer to the want ``physics``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.observation import TILT_SHOWN_DEG, Support
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.records import Contacts, SimulatedPath
from verefine_viz.core.settings import BULLET
from verefine_viz.core.surroundings import SUPPORT_ID, UnknownObject
from verefine_viz.diagnosis.data_doubts import plane_doubt
from verefine_viz.methods.registry import method_of
from verefine_viz.page import protocol as p
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.branch import Branch
from verefine_viz.page.moment import Moment, SceneObject, labels_of, moment_of
from verefine_viz.page.words import moved_by_mm, name_of_contact, turned_by
from verefine_viz.page.workspace import Workspace
from verefine_viz.physics.stability import IMPOSSIBLE_M

Json = dict[str, Any]
RAISED_M = 0.02
"""By ground truth an object whose lowest point is higher above the support plane stands on something [m]."""
GRAVITY_FROM = {"plane": "its normal", "world": "the camera's pose", "given": "scene.gravity"}
OUTLINE_POINTS = 4000
"""Model points from which an outline seen from above is made."""


def physics(space: Workspace, want: p.PhysicsWanted, blobs: Blobs) -> Json:
    """Return what physics says about every object where it stands, and about the focus before and after."""
    branch = space.branch(want.branch)
    look = p.Look(branch=want.branch, k=want.k, obj=want.obj, answer=want.answer, edited=want.edited)
    moment = moment_of(branch, look)
    support = moment.problem.observation.support
    answer: Json = {
        "empty": _off_reason(branch),
        "doubts": doubts_of(branch, support),
        "surroundings": None if support is None else _surroundings(support),
        "objects": [],
        "poses": [],
        "overlaps": [],
        "path": _path(moment, support),
    }
    if support is None:
        return answer
    standing = [o for o in moment.objects if o.T_cam_obj is not None]
    if want.edited is not None:
        standing = [o for o in standing if o.target is moment.target]
    for o in standing:
        T_cam_obj = o.T_cam_obj if want.edited is None else moment.poses["edited"]
        assert T_cam_obj is not None
        answer["objects"].append({"obj": o.instance_id, **_facts(moment, o, T_cam_obj, support)})
    focus = next(o for o in moment.objects if o.target is moment.target)
    for name in _stages(moment):
        answer["poses"].append({"name": name, **_facts(moment, focus, moment.poses[name], support, drawn=True)})
    answer["overlaps"] = _overlaps(moment, want.edited is not None)
    return answer


def _stages(moment: Moment) -> list[str]:
    """Return the poses of the focus that are looked at more closely: before and after, or the answer alone."""
    if "edited" in moment.poses:
        wanted = ("accepted" if "accepted" in moment.poses else "best", "edited")
    elif moment.is_answer or "accepted" not in moment.poses:
        wanted = ("current", "best")
    else:
        wanted = ("current", "simulated", "accepted")
    names = [name for name in wanted if name in moment.poses]
    return [
        name
        for k, name in enumerate(names)
        if not any(np.array_equal(moment.poses[name], moment.poses[other]) for other in names[k + 1 :])
    ]


def _facts(moment: Moment, o: SceneObject, T_cam_obj: Float, support: Support, drawn: bool = False) -> Json:
    """Return what geometry says about a pose of an object among the others; ``drawn``: with what a picture needs."""
    known = moment.evaluator.plausibility(o.target, T_cam_obj, moment.others_of(o.instance_id))
    if known is None:
        return {"tone": "grey", "words": "Physics is not asked here."}
    tone, words = _verdict(moment, o, known)
    labels = labels_of(moment.problem)
    facts: Json = {
        "tone": tone,
        "words": words,
        "gap_mm": known.gap_mm,
        "depth_mm": known.penetration_mm,
        "into": None if known.penetrates is None else name_of_contact(known.penetrates, labels),
        "margin_mm": float(known.margin_mm) if np.isfinite(known.margin_mm) else None,
        "stable": known.is_stable,
        "touches": sorted({name_of_contact(int(i), labels) for i in known.contact_others}),
    }
    if drawn:
        T_world_cam = support.T_world_cam
        points = o.target.model.points
        seen = apply(T_world_cam @ T_cam_obj, points[:: max(1, len(points) // OUTLINE_POINTS)])[:, :2]
        facts |= {
            "outline": _mm(hull(seen)),
            "polygon": _mm(apply(T_world_cam, known.polygon_cam)[:, :2]),
            "com": _mm(apply(T_world_cam, known.com_on_plane_cam[None])[:, :2])[0],
            "contacts": _mm(apply(T_world_cam, known.contact_points_cam)[:, :2]),
        }
    return facts


def _verdict(moment: Moment, o: SceneObject, known: Any) -> tuple[str, str]:
    """Return light and words; grey where a pose hangs on an object that is not placed yet.

    Where ground truth is known, sinking into the support plane counts from where ground truth is: a measured table lies
    millimetres beside it in places, far more than the scatter of its points says.
    """
    light, sentence = known.light, known.sentence
    into = next((other for other in moment.objects if f"into instance {other.instance_id}." in sentence), None)
    if into is not None:
        named = sentence.removesuffix(f"instance {into.instance_id}.") + into.label
        if into.phase == "waiting":
            return "grey", f"{named}, which still waits at its initial pose: unknown yet."
        return light, f"{named}."
    if light == "red" and known.penetrates == SUPPORT_ID and known.penetration_mm > 1e3 * IMPOSSIBLE_M:
        true_mm = -1e3 * (height_above_plane_m(o.target) or 0.0)
        if true_mm > 0 and known.penetration_mm - true_mm <= 1e3 * IMPOSSIBLE_M:
            why = f"so does ground truth, by {true_mm:.1f} mm: it is the measured plane that is off here"
            return "amber", f"{sentence.removesuffix('.')}; {why}."
    return light, sentence


def height_above_plane_m(target: Target) -> float | None:
    """Return how high an object's lowest vertex is above the support plane by ground truth [m]; None without either."""
    T_cam_obj, support = target.instance.T_cam_obj_gt, target.observation.support
    if T_cam_obj is None or support is None:
        return None
    T_world_obj, up = support.T_world_cam @ T_cam_obj, support.normal_world
    return float((target.model.vertices @ (T_world_obj[:3, :3].T @ up)).min() + T_world_obj[:3, 3] @ up)


def _overlaps(moment: Moment, focus_alone: bool) -> list[Json]:
    """Return pairs of objects that are partly in the same place, deepest first; the one solved later is named first."""
    own = moment.target.instance.instance_id
    placed = [o.placed for o in moment.objects if o.placed is not None]
    if focus_alone:
        placed = [q for q in placed if q.instance_id != own] + [
            Placed(own, moment.target.model, moment.poses["edited"])
        ]
    out = []
    for first, second in combinations(placed, 2):
        if focus_alone and own not in (first.instance_id, second.instance_id):
            continue
        overlap = moment.evaluator.overlap(second, first)
        if overlap is not None:
            out.append({"first": second.instance_id, "second": first.instance_id, "depth_mm": overlap.depth_mm})
    return sorted(out, key=lambda one: -one["depth_mm"])


def _path(moment: Moment, support: Support | None) -> Json | None:
    """Return the simulated path of the object's latest iteration: how far it came and what it touched, step by step."""
    iteration = moment.iteration
    path = None if iteration is None else iteration.path
    if iteration is None or path is None:
        return None
    T_0, points = path.Ts_cam_obj[0], moment.target.model.points
    return {
        "k": iteration.index,
        "n": len(path.Ts_cam_obj),
        "poses": [[float(x) for x in T.ravel()] for T in path.Ts_cam_obj],
        "moved_mm": [moved_by_mm(T_0, T, points) for T in path.Ts_cam_obj],
        "turned_deg": [turned_by(T_0, T)[0] for T in path.Ts_cam_obj],
        "contacts": [_contacts(moment, contacts) for contacts in path.contacts],
        "has_contacts": moment.branch.settings.physics.simulator == BULLET,
        "tipping": _tipping(path),
        "words": _path_words(moment, path),
    }


def _contacts(moment: Moment, contacts: Contacts) -> list[Json]:
    """Return what is touched at the end of a step, a row per partner, the hardest pressed first."""
    labels = labels_of(moment.problem)
    rows = []
    for other in np.unique(contacts.others):
        own = contacts.others == other
        rows.append(
            {
                "name": name_of_contact(int(other), labels),
                "n": int(own.sum()),
                "force_n": float(contacts.forces_n[own].sum()),
                "depth_mm": float(1e3 * contacts.depths_m[own].max()),
            }
        )
    return sorted(rows, key=lambda row: -row["force_n"])


def _tipping(path: SimulatedPath) -> Json | None:
    tipping = path.tipping
    return None if tipping is None else {"step": tipping.step, "overhang_mm": 1e3 * tipping.overhang_m}


def _path_words(moment: Moment, path: SimulatedPath) -> str:
    """Say what the refiner made of the simulation's turn, and whether the object tips."""
    assert moment.iteration is not None
    words = []
    if path.tipping is not None:
        overhang_mm = 1e3 * path.tipping.overhang_m
        words.append(
            f"It tips: after step {path.tipping.step} its centre of mass is {overhang_mm:.1f} mm outside its support."
        )
    refined = next((s for s in moment.iteration.stages if s.name == "refined"), None)
    if refined is not None:
        turned_deg = turned_by(path.Ts_cam_obj[0], path.T_cam_obj)[0]
        left_deg = turned_by(path.Ts_cam_obj[0], refined.T_cam_obj)[0]
        if turned_deg > 2 and left_deg < turned_deg / 2:
            words.append(f"The refiner left {left_deg:.1f}° of the simulation's {turned_deg:.1f}°.")
    return " ".join(words)


# The frame: why there is no physics, what is doubtful, what stands around.


def _off_reason(branch: Branch) -> str:
    """Say why nothing is simulated; "" where it is."""
    observation, session = branch.run.problem.observation, branch.settings
    if observation.support is None:
        return f"No physics: {observation.support_note or 'no support plane was found'}."
    if not session.physics.enabled:
        return "Physics is off in the settings: nothing is simulated."
    method = method_of(session.method.name)
    return "" if method.simulates else f"{method.label} does not simulate."


def doubts_of(branch: Branch, support: Support | None) -> list[str]:
    """Return what makes physics doubtful here: the plane, gravity, and objects that stand on others."""
    if support is None:
        return []
    doubts = [plane_doubt(support)]
    if support.tilt_deg > TILT_SHOWN_DEG:
        doubts.append(
            f"The support plane is tilted by {support.tilt_deg:.1f}° against gravity "
            f"({GRAVITY_FROM[support.gravity_source]}): the table leans, or one of the two is wrong."
        )
    method = method_of(branch.settings.method.name)
    if not method.knows_others and method.simulates and branch.settings.physics.enabled and not branch.doubts():
        stacked = _stacked(branch)
        if stacked:
            doubts.append(
                f"{method.label} settles every object on the table alone: {'; '.join(stacked[:3])}, so "
                f"{'it sinks' if len(stacked) == 1 else 'they sink'} in the simulation. VF_b and VF_d place what "
                "supports others first."
            )
    return [doubt for doubt in doubts if doubt]


def _stacked(branch: Branch) -> list[str]:
    """Return objects that stand on others: by the dependency graph, else by ground truth."""
    problem = branch.run.problem
    labels, support, out = labels_of(problem), problem.observation.support, []
    below: dict[int, list[str]] = {}
    for edge in problem.dependencies.edges if problem.dependencies else ():
        if edge.kind == "support" and edge.state != "cut" and edge.first in labels and edge.second in labels:
            below.setdefault(edge.second, []).append(labels[edge.first])
    is_plane = support is None or support.surroundings is None
    for target in problem.targets:
        own, height_m = target.instance.instance_id, height_above_plane_m(target)
        if own in below:
            out.append(f"{labels[own]} stands on {' and '.join(below[own])}")
        elif is_plane and height_m is not None and height_m > RAISED_M:
            out.append(f"{labels[own]} stands {height_m * 1e3:.0f} mm above the table")
    return out


def _surroundings(support: Support) -> Json:
    """Return what supports and stops the objects: the plane alone, or what the depth image or a mesh shows."""
    around = support.surroundings
    plane = {"share": support.inlier_share, "rms_mm": 1e3 * support.rms_m, "tilt_deg": support.tilt_deg}
    if around is None:
        return {"source": "plane", "plane": plane, "surfaces": 1, "solids": 0, "unknown": []}
    return {
        "source": around.source,
        "plane": plane,
        "surfaces": len(around.supporting) - around.catches,
        "solids": len(around.solids) - len(around.surfaces),
        "unknown": [_unknown(one) for one in around.unknown],
    }


def _unknown(one: UnknownObject) -> Json:
    size = np.sort(np.ptp(one.model.vertices, axis=0) * 1e3)[::-1]
    return {"number": one.number, "size_mm": size.tolist(), "dropped": one.is_dropped}


def hull(xy: Float) -> Float:
    """Return the corners of the convex hull of points (n, 2) in order."""
    try:
        return xy[ConvexHull(xy).vertices]
    except QhullError:  # All on a line.
        return xy[:2]


def _mm(xy: Float | Sequence[Float]) -> list[list[float]]:
    return np.round(1e3 * np.asarray(xy).reshape(-1, 2), 2).tolist()
