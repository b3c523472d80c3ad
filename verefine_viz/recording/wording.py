"""An iteration in words, as markdown."""

from __future__ import annotations

import re

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
    start = row.Ts_cam_obj[0]
    for k, stage in enumerate(row.stages):
        score, pixels = row.scores[k], int(row.pixels[k, 0])
        moved_mm, turned_deg = difference(start, row.Ts_cam_obj[k])
        judged = (
            "– | – | – | –" if np.isnan(score[0]) else f"{score[0]:.3f} | {score[1]:.3f} | {score[2]:.3f} | {pixels}"
        )
        name = f"**{stage} ✔**" if stage == row.accepted else stage
        lines[-1] += f"\n| {name} | {judged} | {moved_mm:.1f} mm | {turned_deg:.1f}° |"
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


def difference(T_a: Float, T_b: Float) -> tuple[float, float]:
    """How far one pose is from another: (mm between origins, degrees)."""
    cosine = (float(np.sum(T_a[:3, :3] * T_b[:3, :3])) - 1) / 2
    moved_mm = 1e3 * float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3]))
    return moved_mm, float(np.degrees(np.arccos(min(1.0, max(-1.0, cosine)))))


def plain(text: str) -> str:
    """Text from data, so that markdown shows it as it is."""
    return re.sub(r"([\\`*_{}\[\]<>|#!&~])", r"\\\1", " ".join(text.split()))
