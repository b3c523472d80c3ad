"""What a batch says about the object in focus: why it failed, and why this iteration is the one to look at."""

from __future__ import annotations

from verefine_viz.batch.summary import MUCH, MUCH_SCORE
from verefine_viz.diagnosis.words import DATA_FIRST, cause_title
from verefine_viz.viewer.gallery import Entry
from verefine_viz.viewer.view import View


def batch_words(view: View) -> str:
    """What happened at the iteration where it went wrong, and the cause with its evidence; empty: nothing."""
    entry = view.entry
    if entry is None:
        return ""
    # What is in doubt about the data stands above it by itself.
    verdict = _verdict(entry).partition(f" {DATA_FIRST}")[0]
    return " ".join(filter(None, (_why_here(view, entry), verdict)))


def _verdict(entry: Entry) -> str:
    row = entry.row
    if row.status != "ok":
        return f"In the batch: no answer, {row.message}."
    if not entry.is_wrong or row.relative_error is None:
        return ""
    if row.evidence:
        return f"Why it failed in the batch: {row.evidence}"
    cause = cause_title(row.cause) if row.cause else "no cause was looked for"
    return f"In the batch it was wrong by {row.relative_error:.0%} of the diameter: {cause}."


def _why_here(view: View, entry: Entry) -> str:
    """Why the frame was opened at this iteration of all."""
    at = entry.iteration
    if view.cursor != at or view.progress.running or entry.row.status != "ok":
        return ""
    if at == 0:
        return "No iteration made it much worse, and its answer is a first pose: look before iteration 1."
    if entry.row.worst_iteration is None:
        return f"No iteration made it much worse; iteration {at} made the answer."
    before, after = view.poses.get("current"), view.poses.get("accepted")
    if not view.is_current or before is None or after is None:
        return ""
    if before.errors is not None and after.errors is not None:
        was, now = before.errors.add_s_mm, after.errors.add_s_mm
        much = MUCH * (entry.row.diameter_mm or 0.0)
        lost, change = now - was > much, f"here its error grew most ({was:.1f} → {now:.1f} mm)"
    elif before.score is not None and after.score is not None:
        was, now = before.score.score, after.score.score
        lost, change = was - now > MUCH_SCORE, f"here its score fell most ({was:.2f} → {now:.2f})"
    else:
        return ""
    return f"Iteration {at}: {change}." if lost else ""
