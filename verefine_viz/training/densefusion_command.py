"""The command ``verefine-viz train densefusion``: train, export both networks, measure, write the model cards."""

# pyright: reportMissingImports=false
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from verefine_viz.core.algorithm_settings import DenseFusionSettings
from verefine_viz.core.console import ProgressBar
from verefine_viz.core.geometry import nearest_rotation
from verefine_viz.core.text_format import say
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.learned.densefusion_input import crop_of
from verefine_viz.learned.densefusion_steps import (
    FORMAT,
    POSE_NET,
    REFINE_NET,
    DenseFusionPose,
    DenseFusionSteps,
    extents_mm,
)
from verefine_viz.networks.densefusion_networks import (
    OFFICIAL,
    SLIM,
    pose_net_example,
    refine_net_example,
)
from verefine_viz.networks.onnx_export import onnx_bytes, with_card, write_network
from verefine_viz.training.coloured_scenes import ColouredScenes, coloured_scenes
from verefine_viz.training.course import TrainingProgress, losses_on_card, versions
from verefine_viz.training.train_densefusion import SHARES, TrainedDenseFusion, train_densefusion

HELD_OUT_PICTURES = 40
"""Pictures on which the networks are measured, …"""
HELD_OUT_SEED = 2**31
"""… with a seed that is added to the training's."""


def train_both(
    out: Path,
    slim: bool,
    dataset: Path | None,
    split: str,
    n_points: int,
    seed: int,
    n_steps: int | None,
    minutes: float,
) -> int:
    """Trains PoseNet into ``out`` and PoseRefineNet beside it, ``*_refine.onnx``; the exit code.

    Raises:
        VerefineError: something cannot be read or written, or the checkpoint is of another training.
    """
    checkpoint = out.with_name(f"{out.name}.checkpoint")
    size = SLIM if slim else OFFICIAL
    scenes = coloured_scenes(dataset, split, seed, size.is_halved)
    with ProgressBar("densefusion: drawing views") as bar:

        def report(now: TrainingProgress) -> None:
            bar.show("densefusion", now.step, now.n_steps, describe(now))

        trained = train_densefusion(scenes, size, n_points, seed, n_steps, minutes, checkpoint, report)
    files = {POSE_NET: out, REFINE_NET: out.with_name(f"{out.stem}_refine.onnx")}
    models = {POSE_NET: trained.pose, REFINE_NET: trained.refine}
    examples = {POSE_NET: pose_net_example(), REFINE_NET: refine_net_example(size.colour)}
    command = f"verefine-viz train densefusion --out {out.name} --steps {trained.n_steps} --seed {seed}"
    command += f" --points {n_points}" + ("" if slim else " --no-slim")
    command += f" --dataset {dataset.resolve().name}" if dataset else ""
    command += f" --split {split}" if split else ""
    cards = {name: card_of(name, trained, scenes, n_points, seed, command) for name in files}
    contents = {name: onnx_bytes(models[name], *examples[name], cards[name]) for name in files}
    for name, file in files.items():
        write_network(file, contents[name], cards[name])
    say("Measuring them on pictures that they have not seen.", sys.stderr)
    measured = measured_on(coloured_scenes(dataset, split, seed + HELD_OUT_SEED), files[POSE_NET], files[REFINE_NET])
    for name, file in files.items():
        # Pictures of a data set would be drawn from the frames of the training.
        cards[name]["measured_on"] = "the same frames in another order" if split else "other made-up views"
        cards[name]["measured"] = measured
        write_network(file, with_card(contents[name], cards[name]), cards[name])
        say(f"{file}: {len(contents[name]) / 1e6:.2f} MB; {file.with_suffix('.json')}: its model card", sys.stderr)
    checkpoint.unlink(missing_ok=True)
    for what, row in measured.items():
        say(
            f"{what}: ADD(-S) {row['median_percent_of_diameter']:.1f} % of the diameter (median of {row['n']}), "
            f"{row['share_below_10_percent']:.0%} below 10 %",
            sys.stderr,
        )
    say(
        f"To use them: --densefusion.weights {files[POSE_NET]} --densefusion.refiner-weights {files[REFINE_NET]}",
        sys.stderr,
    )
    return 0


def describe(now: TrainingProgress) -> str:
    """``loss 0.0312, ADD(-S) 12.3 mm``."""
    return f"loss {now.loss:.4f}, ADD(-S) {1000 * now.error:.1f} mm"


def card_of(
    name: str, trained: TrainedDenseFusion, scenes: ColouredScenes, n_points: int, seed: int, command: str
) -> dict[str, Any]:
    """The model card without the measurements."""
    parameters = sum(p.numel() for p in (trained.pose if name == POSE_NET else trained.refine).parameters())
    return {
        "network": name,
        "format": FORMAT,
        "n_classes": len(scenes.models),
        "classes": [model.obj_id for model in scenes.models],
        "objects": [model.name for model in scenes.models],
        "extents_mm": [list(extents_mm(model)) for model in scenes.models],
        "points": n_points,
        "purpose": "DenseFusion: the 6D pose of the objects that it was trained on, from a colour and depth image",
        "command": command,
        "seed": seed,
        "steps": trained.n_steps,
        "shares_of_steps": dict(zip(("whole_pose_net", "heads_of_pose_net", "refine_net"), SHARES, strict=True)),
        "parameters": parameters,
        "data": scenes.described,
        "loss": [{"step": s, "loss": round(a, 5), "add_m": round(b, 5)} for s, a, b in losses_on_card(trained.losses)],
        "made_with": versions(),
    }


def measured_on(scenes: ColouredScenes, pose_file: Path, refine_file: Path) -> dict[str, dict[str, Any]]:
    """ADD(-S) as a share of the diameter, for the most confident pose and after two steps of refinement."""
    pose, steps = (
        DenseFusionPose(pose_file, DenseFusionSettings()),
        DenseFusionSteps(refine_file, DenseFusionSettings()),
    )
    errors: list[list[float]] = []
    for k in range(HELD_OUT_PICTURES):
        for seen in scenes.picture(k):
            crop = crop_of(seen.rgb, seen.depth_m, seen.mask, seen.camera, pose.classes.n_points, 0)
            if crop is None:
                continue
            poses = pose.poses_of(crop, seen.model)
            T = poses.Ts_cam_obj[int(poses.confidences.argmax())]
            T[:3, :3] = nearest_rotation(T[:3, :3])
            refined = steps.refined(T, poses.colours, seen.model, 2)
            errors.append([pose_errors(seen.model, one, seen.T_cam_obj).relative for one in (T, refined)])
    rows = {}
    for what, shares in zip(("pose_net", "after_two_steps"), np.array(errors).reshape(-1, 2).T, strict=True):
        rows[what] = {
            "n": len(shares),
            "median_percent_of_diameter": round(100 * float(np.median(shares)), 2) if len(shares) else 0.0,
            "share_below_10_percent": round(float((shares < 0.1).mean()), 3) if len(shares) else 0.0,
        }
    return rows
