"""Numbers and findings as the report's sentences."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from verefine_viz.batch.doubts import doubts_in_words
from verefine_viz.report.difference import Difference
from verefine_viz.report.gallery import Gallery
from verefine_viz.report.groups import names, seed_words
from verefine_viz.report.loaded import Loaded, data_set
from verefine_viz.report.numbers import Numbers, lies
from verefine_viz.report.pair_gallery import BOTH, ONLY_A, ONLY_B

DASH = "–"


def data_doubts(runs: Sequence[Loaded]) -> list[str]:
    """What the runs say of data that do not fit together, with which run it is where there are two."""
    said = [(run, doubts_in_words([(run.name, run.rows)])) for run in runs]
    return [f"{run.label}: {doubt}" if run.label else doubt for run, doubt in said if doubt]


def percent(share: float | None, digits: int = 0) -> str:
    """0.891 → 89 %."""
    return (
        DASH
        if share is None or math.isnan(share)
        else f"{100 * share:.{digits}f} %"
        if math.isfinite(share)
        else "no answer"
    )


def number(value: float | None, digits: int = 1, unit: str = "") -> str:
    """12.34 → 12.3 mm."""
    if value is None or not math.isfinite(value):
        return DASH
    return f"{value:,.{digits}f}".replace(",", "\u202f") + (f" {unit}" if unit else "")


def signed(value: float | None, digits: int = 1, unit: str = "") -> str:
    """A difference with its sign."""
    if value is None or not math.isfinite(value):
        return DASH
    # What rounds to nothing is no change: neither +0.0 nor −0.0.
    shown = f"{value:+.{digits}f}" if round(value, digits) else f"{0:.{digits}f}"
    return shown.replace("-", "−") + (f" {unit}" if unit else "")


def tone(gain: float, digits: int = 1) -> str:
    """``good``, ``bad``, or nothing where a gain shows as zero."""
    if math.isnan(gain) or round(min(max(gain, -1e9), 1e9), digits) == 0:
        return ""
    return "good" if gain > 0 else "bad"


def title(a: Loaded, b: Loaded | None = None) -> str:
    """What the report is about, whatever the sessions are called: a run, or what differs between two."""
    if b is None:
        return f"{a.method} on {data_set(a)}"
    pairs = (names((a.index.session, b.index.session)), (seed_words(a), seed_words(b)), (a.folder.name, b.folder.name))
    differing = [(x, y) for x, y in pairs[:2] if x != y] or [pairs[2]]
    of_a, of_b = (", ".join(parts) for parts in zip(*differing, strict=True))
    both = f"{a.method}: " if a.method == b.method else ""
    return f"{both}{of_a} (A) against {of_b} (B)"


def session_title(runs: Sequence[Loaded]) -> str:
    """The title of the runs' sessions; empty where they have different ones, or none."""
    titles = {run.index.session.title for run in runs}
    return titles.pop() if len(titles) == 1 else ""


def headline(run: Loaded, n: Numbers) -> str:
    """The run in a sentence."""
    objects = f"{n.n_objects} objects in {n.n_frames} frame{'s' * (n.n_frames != 1)}"
    if n.recall is None:
        return f"{run.method} on {objects}; without ground truth nobody can say which answers are right."
    right = round(n.recall * n.n_with_truth)
    said = f"{run.method} got {right} of {n.n_with_truth} objects right (error below 10 % of the diameter)"
    rest = []
    if n.n_without_answer:
        rest.append(f"{n.n_without_answer} without a hypothesis")
    if n.n_left_out:
        rest.append(f"{n.n_left_out} left out as their mask or model cannot be used")
    if n.n_failed_frames:
        held = f" with {n.n_in_failed_frames} objects" if n.n_in_failed_frames else ""
        rest.append(f"{n.n_failed_frames} of {n.n_frames} frames failed as a whole{held}")
    return f"{said}{'; ' * bool(rest)}{', '.join(rest)}."


def score_sentence(run: Loaded) -> str:
    """Whether the score can be trusted."""
    share = lies(run)
    if share is None:
        return "There are not both right and wrong answers with a score, so nothing can be said about the score."
    n_right = sum(row.is_correct is True for row in run.objects)
    n_wrong = sum(row.is_correct is False for row in run.objects)
    verdict = (
        "tells right from wrong"
        if share < 0.1
        else "often misleads"
        if share > 0.3
        else "mostly tells right from wrong"
    )
    return (
        f"The score {verdict}: of all pairs of a wrong and a right answer, the wrong one scores higher in {share:.0%} "
        f"({n_wrong} wrong, {n_right} right). "
        "Crosses in the upper right are where it lies."
    )


def difference_sentence(found: Difference) -> str:
    """What changed from A to B."""
    right = sum(c.turned == "now right" for c in found.changes)
    wrong = sum(c.turned == "now wrong" for c in found.changes)
    said = (
        f"Of {len(found.changes)} objects that both runs have, B is better in {len(found.better)} and worse in "
        f"{len(found.worse)}; {right} became right, {wrong} became wrong."
    )
    left = [f"{n} only in {side}" for n, side in ((found.only_a, "A"), (found.only_b, "B")) if n]
    return said + (f" Left out: objects {' and '.join(left)}." if left else "")


def pair_failures_sentence(failures: Gallery, has_truth: bool) -> str:
    """What the gallery of two compared runs shows."""
    n_shown = len(failures.failures)
    if not has_truth or not n_shown:
        return failures_sentence(n_shown, failures.n_more, has_truth)
    counts = Counter(card.pick.group for card in failures.failures)
    listed = ", ".join(f"{counts[kind]} {kind}" for kind in (ONLY_A, ONLY_B, BOTH) if counts[kind])
    more = f"; {failures.n_more} more in the runs' frames.csv" if failures.n_more else ""
    return f"{n_shown} object{'s' * (n_shown != 1)} that one run or both got wrong, worst first: {listed}{more}."


def failures_sentence(n_shown: int, n_more: int, has_truth: bool) -> str:
    """What the gallery shows."""
    if not n_shown:
        hidden = f"{n_more} failures, none of them shown (--failures)."
        return hidden if n_more else "Nothing that could be solved came out wrong."
    what = "failure" if has_truth else "object"
    order = "worst first" if has_truth else "lowest score first, as there is no ground truth"
    more = f"; {n_more} more in frames.csv" if n_more else ""
    return f"{n_shown} {what}{'s' * (n_shown != 1)}, {order}{more}."
