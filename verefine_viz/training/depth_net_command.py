"""What ``verefine-viz train`` does: train, export, measure, write the model card."""

# pyright: reportMissingImports=false
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import torch

from verefine_viz.core.console import ProgressBar
from verefine_viz.core.text_format import say
from verefine_viz.learned.depth_crops import CHANNELS, FORMAT, SIDE_PX
from verefine_viz.learned.onnx_network import OnnxNetwork
from verefine_viz.networks.onnx_export import onnx_bytes, with_card, write_network
from verefine_viz.refiners.depth_net import NETWORK
from verefine_viz.training.course import TrainingProgress, losses_on_card, versions
from verefine_viz.training.depth_net_samples import LARGEST_DEG, LARGEST_SHIFT
from verefine_viz.training.held_out import measured
from verefine_viz.training.synthetic_views import DISTANCE_M, FOCAL_PX, LEAST_VISIBLE, OBJECT_PX, OFF_AXIS_DEG
from verefine_viz.training.train_depth_net import BATCH_SIZE, Trained, train
from verefine_viz.training.training_shapes import DIAMETER_M, N_HELD_OUT, N_RANDOM


def train_depth_net(out: Path, seed: int, n_steps: int | None, minutes: float) -> int:
    """Trains the network into ``out``; the exit code. Beside it lies a checkpoint until it is done.

    Raises:
        InputError: something cannot be written, or the checkpoint is of another training.
    """
    checkpoint = out.with_name(f"{out.name}.checkpoint")
    with ProgressBar(f"{NETWORK}: drawing views") as bar:

        def report(now: TrainingProgress) -> None:
            bar.show(NETWORK, now.step, now.n_steps, describe(now))

        trained = train(seed, n_steps, minutes, checkpoint, report)
    say("Measuring it on shapes that it has not seen.", sys.stderr)
    card = card_of(trained, seed, out.name)
    example, sizes = (torch.zeros(2, len(CHANNELS), SIDE_PX, SIDE_PX),), ({0: torch.export.Dim("n")},)
    content = onnx_bytes(trained.model, example, sizes, card)
    write_network(out, content, card)
    card["held_out"] = measured(OnnxNetwork(out, NETWORK, FORMAT))
    write_network(out, with_card(content, card), card)
    checkpoint.unlink(missing_ok=True)
    say(f"{out}: {len(content) / 1e6:.2f} MB; {out.with_suffix('.json')}: its model card", sys.stderr)
    for line in card["held_out"]:
        say(
            f"from {line['start_deg']:.0f}°: {line['median_start_percent_of_diameter']:.1f} % of the diameter → "
            f"{line['median_percent_of_diameter']:.1f} %, {line['share_below_10_percent']:.0%} below 10 %",
            sys.stderr,
        )
    say(f"To use it: --method.refiner {NETWORK}_icp --depth-net.weights {out}", sys.stderr)
    return 0


def describe(now: TrainingProgress) -> str:
    """``loss 0.312, 4.5 % of the diameter left after a step``."""
    return f"loss {now.loss:.3f}, {50 * now.error:.1f} % of the diameter left after a step"


def card_of(trained: Trained, seed: int, file: str) -> dict[str, Any]:
    """The model card, but for what is measured."""
    return {
        "network": NETWORK,
        "format": FORMAT,
        "purpose": "refines the 6D pose of any rigid object from one depth image, its mask and its model",
        "command": f"verefine-viz train {NETWORK} --out {file} --steps {trained.n_steps} --seed {seed}",
        "seed": seed,
        "steps": trained.n_steps,
        "samples": trained.n_steps * BATCH_SIZE,
        "parameters": sum(p.numel() for p in trained.model.parameters()),
        "data": {
            "views": "made up: an object among others on a table, sensor noise, holes, occluders, masks too wide, too "
            "narrow, with a neighbour's pixels, or without a part",
            "shapes": f"{N_RANDOM - N_HELD_OUT} objects of pybullet_data/random_urdfs (zlib licence, as Bullet) and "
            "solids by formula, stretched at random; no object of a data set or of a built-in scene",
            "held_out": f"the other {N_HELD_OUT} objects of pybullet_data/random_urdfs, and solids with other seeds",
        },
        "trained_range": {
            "rotation_deg": LARGEST_DEG,
            "shift_radii": LARGEST_SHIFT,
            "diameter_m": list(DIAMETER_M),
            "distance_m": list(DISTANCE_M),
            "focal_px": list(FOCAL_PX),
            "object_px": list(OBJECT_PX),
            "off_axis_deg": OFF_AXIS_DEG,
            "least_visible_share": LEAST_VISIBLE,
        },
        "loss": [
            {"step": s, "loss": round(a, 4), "error_radii": round(b, 4)} for s, a, b in losses_on_card(trained.losses)
        ],
        "made_with": versions(),
    }
