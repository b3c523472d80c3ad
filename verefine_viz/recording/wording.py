"""An iteration in words, as markdown."""

from __future__ import annotations

import math

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.recording.layout import Branch
from verefine_viz.recording.row import Row


def describe(row: Row, branch: Branch) -> str:
    """What happened in this iteration and why, for the text panel."""
    source = plain(branch.sources[row.arm]) if row.arm < branch.n_arms else ""
    lines = [
        f"## Iteration {row.index}: {branch.name}",
        f"**Hypothesis {row.arm + 1} of {branch.n_arms}** ({source}), its iteration {row.arm_iteration}.",
    ]
    if row.reason:
        lines.append(f"Why this one: {plain(row.reason)}")
    lines.append("| stage | score | f_d | f_n | N | moved | turned |\n|-|-:|-:|-:|-:|-:|-:|")
    moved_mm, turned_deg = differences(row.Ts_cam_obj)
    for k, stage in enumerate(row.stages):
        score, pixels = row.scores[k], int(row.pixels[k, 0])
        judged = (
            "– | – | – | –" if np.isnan(score[0]) else f"{score[0]:.3f} | {score[1]:.3f} | {score[2]:.3f} | {pixels}"
        )
        name = f"**{stage} ✔**" if stage == row.accepted else stage
        lines[-1] += f"\n| {name} | {judged} | {moved_mm[k]:.1f} mm | {turned_deg[k]:.1f}° |"
    where = f"iteration {row.best_iteration}" if row.best_iteration else "the start"
    lines.append(f"Best so far: {row.best_score[0]:.3f}, hypothesis {row.best_arm + 1}, {row.best_stage}, {where}.")
    if branch.has_truth:
        rotation_deg, translation_mm, add_mm = row.errors
        lines.append(
            f"Against ground truth: kept pose {rotation_deg:.1f}° and {translation_mm:.1f} mm off;"
            f" best pose ADD(-S) {add_mm:.1f} mm."
        )
    if row.event_texts:
        lines.append("\n".join(f"- {plain(text)}" for text in row.event_texts))
    return "\n\n".join(lines)


def differences(Ts_cam_obj: Float) -> tuple[list[float], list[float]]:
    """How far each of the poses (n, 4, 4) is from the first: mm between origins, degrees."""
    # A handful of poses: numbers one by one are faster than arrays here.
    (*first, _), *_ = poses = Ts_cam_obj.tolist()
    moved_mm, turned_deg = [], []
    for pose in poses:
        moved_mm.append(1e3 * math.dist([row[3] for row in first], [row[3] for row in pose[:3]]))
        trace = sum(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] for a, b in zip(first, pose[:3], strict=True))
        turned_deg.append(math.degrees(math.acos(min(1.0, max(-1.0, (trace - 1) / 2)))))
    return moved_mm, turned_deg


def plain(text: str) -> str:
    """Text from data, so that markdown shows it as it is."""
    return " ".join(text.split()).translate(_ESCAPED)


_ESCAPED = str.maketrans({c: f"\\{c}" for c in "\\`*_{}[]<>|#!&~"})
