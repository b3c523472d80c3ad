"""How right labels are that were snapped from poses as people make them, and whether wrong ones show it.

    python -m bench.snapping DATASET_FOLDER [--seeds 3] [--baseline]

Ground truth of a data set in BOP layout is hidden, and so are its masks. A start is where a person clicked: up to 15 px
beside the middle, 20 mm in depth, 25° about the vertical and 10° about another axis, at random. Other objects stand
where they are, or nothing is known of them. Rows of wrong starts show whether a label that is wrong looks verified:
turned over, beside the object, the model of another object in its place. "Wrong" is ADD(-S) from 10 % of the diameter.
``--baseline`` solves the same starts by SIR with ten iterations, on the masks of the data set.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import numpy as np
from rich.console import Console

from bench.__main__ import table
from bench.labelling import Known, known_objects, toolbox
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.problem import Hypothesis, Placed
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.evaluation.rotation_errors import symmetric_angles_rad
from verefine_viz.labels.placing import up_of
from verefine_viz.labels.verification import labelled
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.labels import Label

PX, DEPTH_MM, TURN_DEG, TILT_DEG = 15.0, 20.0, 25.0, 10.0
NEAR_MM, NEAR_DEG = 2.0, 2.0


@dataclass(frozen=True, eq=False)
class Snap:
    """A label and how far it is off."""

    name: str
    label: Label
    add_mm: float
    middle_mm: float
    turned_deg: float
    is_wrong: bool
    spent_s: float


def person_start(known: Known, rng: np.random.Generator) -> Float:
    """Where a person would put an object, (4, 4)."""
    truth, camera, up = known.truth, known.observation.camera, up_of(known.observation)
    T = truth.instance.T_cam_obj_gt
    assert T is not None
    middle = apply(T, truth.model.middle_m[None])[0]
    z = middle[2] + 1e-3 * rng.uniform(-DEPTH_MM, DEPTH_MM)
    beside = rng.uniform(-PX, PX, 2) * z / np.array([camera.fx, camera.fy])
    there = np.append(middle[:2] / middle[2] * z + beside, z)
    tilt = np.cross(up, rng.normal(size=3))
    R = axis_angle(up, np.radians(rng.uniform(-TURN_DEG, TURN_DEG)))
    R = R @ axis_angle(tilt, np.radians(rng.uniform(-TILT_DEG, TILT_DEG)))
    return transform(R, there - R @ middle) @ T


def turned_over(known: Known, rng: np.random.Generator) -> Float:
    """Half or a quarter of a turn off, about the vertical or across."""
    T, up = person_start(known, rng), up_of(known.observation)
    axis = up if rng.random() < 0.5 else np.cross(up, rng.normal(size=3))
    middle, R = apply(T, known.truth.model.middle_m[None])[0], axis_angle(axis, float(rng.choice([np.pi, np.pi / 2])))
    return transform(R, middle - R @ middle) @ T


def beside(known: Known, rng: np.random.Generator) -> Float:
    """Some 60 mm away."""
    T = person_start(known, rng).copy()
    T[:3, 3] += 0.06 * rng.normal(size=3)
    return T


STARTS: dict[str, Callable[[Known, np.random.Generator], Float]] = {
    "as people place it": person_start,
    "turned over": turned_over,
    "beside it": beside,
}


def snap(tools: Toolbox, known: Known, T_start: Float, others: Sequence[Placed]) -> Snap:
    """Label an object from a start."""
    truth, began = known.truth, process_time()
    label = labelled(tools, known.observation, Placed(truth.instance.instance_id, truth.model, T_start), others)
    return judged(known, label, process_time() - began)


def judged(known: Known, label: Label, spent_s: float) -> Snap:
    """How far a label is off."""
    model, T, T_gt = known.truth.model, label.pose, known.truth.instance.T_cam_obj_gt
    assert T_gt is not None
    errors, middle = pose_errors(model, T, T_gt), model.middle_m[None]
    turned = float(np.degrees(symmetric_angles_rad(model, T, T_gt).min()))
    off_mm = 1e3 * float(np.linalg.norm(apply(T, middle) - apply(T_gt, middle)))
    return Snap(known.name, label, errors.add_s_mm, off_mm, turned, not errors.is_correct, spent_s)


def neighbours(known: Known, all_known: Sequence[Known]) -> list[Placed]:
    """The other objects of the frame at their true poses."""
    there = [one.truth for one in all_known if one.observation is known.observation and one is not known]
    return [
        Placed(one.instance.instance_id, one.model, one.instance.T_cam_obj_gt)
        for one in there
        if one.instance.T_cam_obj_gt is not None
    ]


def wrong_models(tools: Toolbox, all_known: Sequence[Known], n_seeds: int) -> list[Snap]:
    """Other objects' models put where an object is: every label is wrong."""
    models = {one.truth.model.obj_id: one.truth.model for one in all_known}
    out = []
    for k, known in enumerate(all_known):
        others = [model for obj_id, model in models.items() if obj_id != known.truth.model.obj_id]
        for seed in range(n_seeds):
            rng = np.random.default_rng([k, seed, 3])
            model = others[int(rng.integers(len(others)))]
            T_gt = known.truth.instance.T_cam_obj_gt
            assert T_gt is not None
            upright = person_start(known, rng)
            middle = apply(upright, known.truth.model.middle_m[None])[0]
            R = upright[:3, :3]
            placed = Placed(known.truth.instance.instance_id, model, transform(R, middle - R @ model.middle_m))
            label = labelled(tools, known.observation, placed, neighbours(known, all_known))
            out.append(Snap(f"{model.name} on {known.name}", label, np.nan, np.nan, np.nan, True, 0.0))
    return out


def baseline(tools: Toolbox, all_known: Sequence[Known], n_seeds: int) -> list[Snap]:
    """SIR on the masks of the data set, from the same starts."""
    out = []
    sir = tools.changed({"method": {"name": "sir", "iterations": 10}})
    problems = {frame: tools.problem(frame) for frame in tools.frames}
    for k, known in enumerate(all_known):
        problem = problems[known.name.split()[0]]
        own = known.truth.instance.instance_id
        for seed in range(n_seeds):
            start = Hypothesis(person_start(known, np.random.default_rng([k, seed])), 1.0, "person")
            instance = replace(problem.target(own).instance, hypotheses=(start,))
            began = process_time()
            run = sir.run(replace(problem.only([own]), instances=(instance,)))
            run.finish()
            best = run.final_state.best[0]
            assert best is not None
            label = Label(own, instance.obj_id, "", tuple(best.T_cam_obj.ravel().tolist()), "green")
            out.append(judged(known, label, process_time() - began))
    return out


def row(name: str, snaps: Sequence[Snap]) -> dict[str, object]:
    """A row of the table."""
    wrong = [one for one in snaps if one.is_wrong]
    shown = sum(one.label.light != "green" for one in wrong)
    right = [one for one in snaps if not one.is_wrong]
    near = sum(one.middle_mm < NEAR_MM and one.turned_deg < NEAR_DEG for one in snaps)
    return {
        "start": name,
        "n": len(snaps),
        "right": f"{len(right)}",
        "median mm": float(np.median([one.add_mm for one in snaps])),
        "middle mm": float(np.median([one.middle_mm for one in snaps])),
        "turned °": float(np.median([one.turned_deg for one in snaps])),
        "within 2 mm, 2°": near,
        "right and green": sum(one.label.light == "green" for one in right),
        "wrong and not green": f"{shown} of {len(wrong)}",
        "CPU s": float(np.median([one.spent_s for one in snaps])),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--baseline", action="store_true")
    given = parser.parse_args()
    tools = toolbox(given.dataset, "")
    all_known = [*known_objects(tools)]
    rows, missed = [], list[Snap]()
    for name, start in STARTS.items():
        for there in (True, False) if start is person_start else (True,):
            snaps = [
                snap(
                    tools,
                    known,
                    start(known, np.random.default_rng([k, seed])),
                    neighbours(known, all_known) if there else (),
                )
                for k, known in enumerate(all_known)
                for seed in range(given.seeds)
            ]
            rows.append(row(name if there else f"{name}, alone", snaps))
            missed += [one for one in snaps if one.is_wrong and one.label.light == "green"]
            print(rows[-1], flush=True)
    others = wrong_models(tools, all_known, given.seeds)
    rows.append(row("another model", others))
    missed += [one for one in others if one.label.light == "green"]
    if given.baseline:
        rows.append(row("SIR on true masks", baseline(tools, all_known, given.seeds)))
    console = Console(width=170)
    console.print(table(f"snapping, {len(all_known)} objects, {given.seeds} seeds", rows, 1))
    for one in missed:
        console.print(
            f"green and wrong: {one.name}, {one.add_mm:.0f} mm, {one.turned_deg:.0f}°, score {one.label.score}"
        )


if __name__ == "__main__":
    main()
