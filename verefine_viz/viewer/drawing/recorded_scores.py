"""What another program recorded about its poses: its own score of the pose at hand, and whether it agrees with ours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from verefine_viz.core.problem import RecordedStep
from verefine_viz.methods.registry import METHODS, method_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import carries, link, text
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.text.display_names import arm_color

GOES_ON = "rir"
"""The method that continues a trace."""
WIDTH, HEIGHT, LEFT, BOTTOM, MARGIN = 272, 108, 30, 26, 8
FEWEST = 4
"""Poses below which a correlation has no meaning."""


def recorded_step(snapshot: Snapshot) -> RecordedStep | None:
    """The recorded step that the shown iteration took; None where it was computed here."""
    shown = snapshot.shown
    refined = shown.stage("refined") if shown is not None else None
    if shown is None or refined is None or snapshot.is_answer:
        return None
    own = [step for step in snapshot.target.instance.recorded if step.hypothesis == shown.arm]
    step = own[shown.arm_iteration - 1] if shown.arm_iteration <= len(own) else None
    return step if step is not None and np.array_equal(step.T_cam_obj, refined.T_cam_obj) else None


def recorded_line(snapshot: Snapshot) -> str:
    """What was recorded about the shown iteration, and how to go on from there; empty where nothing was."""
    lines = []
    step = recorded_step(snapshot)
    if step is not None:
        parts = [f"recorded step “{step.name}”"]
        parts += [f"its own score {step.score:.4g}"] if step.score is not None else []
        parts += [step.note] if step.note else []
        lines.append(f"<p>{text(' · '.join(parts))}</p>")
    if method_of(snapshot.session.method.name).repeats and snapshot.recording is None and snapshot.n_arms:
        label = METHODS[GOES_ON].label
        fork = c.Fork((("method.name", GOES_ON), ("method.iterations", _budget(snapshot))), run=True)
        beside = c.CompareRun((("method.name", GOES_ON),), run=True)
        lines.append(
            f"<p>{link(f'Continue from here with {label}', fork, 'a new branch: its hypotheses are the poses here')} · "
            f"{link(f'compare with {label}', beside, f'B: {label} from the same initial poses, beside the trace')}</p>"
        )
    return "".join(lines)


def _budget(snapshot: Snapshot) -> int:
    """Iterations per hypothesis that leave the usual number after those up to the cursor."""
    made = 0
    for instance in snapshot.problem.instances:
        n = sum(i.instance_id == instance.instance_id for i in snapshot.iterations[: snapshot.cursor])
        made = max(made, -(-n // max(len(instance.hypotheses), 1)))
    return made + snapshot.session.method.iterations


@dataclass(frozen=True)
class ScoredPose:
    """A recorded pose with both scores."""

    arm: int
    theirs: float
    ours: float
    command: c.Command
    """Goes there."""
    label: str


def scored_poses(snapshot: Snapshot) -> tuple[ScoredPose, ...]:
    """The recorded poses of the object in focus, up to the end of the run, whose score was recorded too."""
    instance, state = snapshot.target.instance, snapshot.state
    if state is None or not instance.recorded_scores:
        return ()
    poses = [
        ScoredPose(j, theirs, state.initial[j].score, c.Seek(0), f"hypothesis {j + 1}, initial")
        for j, theirs in enumerate(instance.recorded_scores[: len(state.initial)])
        if theirs is not None
    ]
    own = {j: [s for s in instance.recorded if s.hypothesis == j] for j in range(snapshot.n_arms)}
    for it in snapshot.own_iterations:
        refined, steps = it.stage("refined"), own[it.arm]
        step = steps[it.arm_iteration - 1] if it.arm_iteration <= len(steps) else None
        if step is None or step.score is None or refined is None or refined.score is None:
            continue
        if np.array_equal(step.T_cam_obj, refined.T_cam_obj):
            where = f"hypothesis {it.arm + 1}, iteration {it.index}: {step.name}"
            poses.append(ScoredPose(it.arm, step.score, refined.score.score, visit(snapshot, it), where))
    return tuple(poses)


def rank_correlation(poses: tuple[ScoredPose, ...]) -> float | None:
    """Spearman's, of their score and ours, in [−1, 1]; None where it has no meaning."""
    theirs, ours = rankdata([p.theirs for p in poses]), rankdata([p.ours for p in poses])
    if len(poses) < FEWEST or np.ptp(theirs) == 0 or np.ptp(ours) == 0:
        return None
    return float(np.corrcoef(theirs, ours)[0, 1])


def agreement(poses: tuple[ScoredPose, ...]) -> str:
    """How far the two scores agree, in a number."""
    rank = rank_correlation(poses)
    of = f"{len(poses)} poses"
    return f"Recorded score and ours: {of}" if rank is None else f"Rank correlation of the scores: {rank:.2f} ({of})"


def agreement_html(snapshot: Snapshot) -> str:
    """The number and a plot of our score over the recorded one; a click goes to a pose. Empty without any."""
    poses = scored_poses(snapshot)
    if not poses:
        return ""
    low, high = min(p.theirs for p in poses), max(p.theirs for p in poses)
    top = max(max(p.ours for p in poses), 0.1)
    right, floor = WIDTH - MARGIN, HEIGHT - BOTTOM

    def at(p: ScoredPose) -> tuple[float, float]:
        x = (p.theirs - low) / (high - low) if high > low else 0.5
        return LEFT + 6 + x * (right - LEFT - 12), floor - p.ours / top * (floor - MARGIN)

    dots = "".join(
        f'<circle cx="{at(p)[0]:.1f}" cy="{at(p)[1]:.1f}" r="4" fill="rgb{arm_color(p.arm)}" stroke="black" '
        f'stroke-opacity="0.4" style="cursor:pointer" {carries(p.command)}><title>{text(p.label)}: '
        f"{p.theirs:.4g}, ours {p.ours:.3f}</title></circle>"
        for p in poses
    )
    axes = (
        f'<path d="M{LEFT} {MARGIN}V{floor}H{right}" stroke="currentColor" opacity="0.5" fill="none"/>'
        f'<text x="{LEFT}" y="{floor + 11}">{low:.3g}</text>'
        f'<text x="{right}" y="{floor + 11}" text-anchor="end">{high:.3g}</text>'
        f'<text x="{LEFT - 4}" y="{floor}" text-anchor="end">0</text>'
        f'<text x="{LEFT - 4}" y="{MARGIN + 7}" text-anchor="end">{top:.2f}</text>'
        f'<text x="{(LEFT + right) / 2}" y="{HEIGHT - 3}" text-anchor="middle">our score over the recorded one</text>'
    )
    return (
        f"<p>{text(agreement(poses))}</p>"
        f'<svg width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="our score over the recorded one"><g font-size="9" fill="currentColor">{axes}</g>{dots}</svg>'
    )
