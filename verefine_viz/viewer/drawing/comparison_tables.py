"""Two compared runs: where they part in words, both at one moment and at their ends in tables. Names are escaped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from verefine_viz.core.palette import SIDE_COLORS
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.run.compare import Departure, Effort, Outcome, ScoredBest, Winner
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.commands import Focus
from verefine_viz.viewer.drawing.markup import (
    NONE,
    Column,
    Row,
    cut,
    fitted,
    link,
    number,
    swatch,
    table,
    table_of,
    text,
    warning,
)
from verefine_viz.viewer.drawing.pose_tables import NOT_COMPARABLE
from verefine_viz.viewer.snapshot.comparison_snapshot import ComparisonSnapshot
from verefine_viz.viewer.text.display_names import TERMS, counted

# Scores of two runs side by side: what they say where both score by the same settings, and where they do not.


def better(v: ComparisonSnapshot, o: Outcome) -> Winner | None:
    """Who has an object nearer to ground truth, or scores it higher; None where neither can be said."""
    return o.winner if v.scores_alike or _is_known(o) else None


def scores_note(v: ComparisonSnapshot) -> str:
    """A box above scores that do not compare; empty where they do."""
    # Two renderers of one rule agree to the last digits that matter.
    rules = [r for r in v.settings if r[0].startswith("score.") and r[0] != "score.renderer"]
    if v.scores_alike or not rules:
        return ""
    differences = "; ".join(f"{name} is {plain(one)} in A, {plain(other)} in B" for name, one, other in rules)
    instead = "Without ground truth nothing here says which is better: give both the same."
    if any(_is_known(o) for o in v.outcomes):
        instead = "Errors against ground truth are."
    return warning(f"Scores of A and B are {NOT_COMPARABLE}: {differences}. {instead}")


def plain(value: Any) -> str:
    """The value of a setting, cut where it is long."""
    words = f"{value:g}" if isinstance(value, float) else str(value)
    return words if len(words) <= 40 else f"{words[:39]}…"


def _is_known(o: Outcome) -> bool:
    """Whether ground truth says how far off both are."""
    return o.a is not None and o.b is not None and o.a.errors is not None and o.b.errors is not None


# Where both part.


def parting(v: ComparisonSnapshot) -> str:
    """As in: A (rir) and B (sir) do the same for 1 iteration. Then in iteration 2 B works on hypothesis 3."""
    a, b, deed, score = f"A ({v.name_a})", f"B ({v.name_b})", v.departures.deed, v.departures.score
    n_both = min(v.effort_a.iterations, v.effort_b.iterations)
    if deed is not None:
        return f"{a} and {b} {_until(deed)} {_deed(deed)}."
    if score is not None:
        return f"{a} and {b} reach the same poses, but score them differently: {_at(score)}, B {score.text}."
    if n_both == 0:
        return f"{a} and {b} start from the same poses."
    return f"{a} and {b} did the same in all {n_both} iterations that both have made, bit for bit."


def _until(deed: Departure) -> str:
    """Up to where both do the same."""
    if deed.place < 2:
        return "part at once:" if deed.place else "begin differently:"
    return f"do the same for {counted(deed.place - 1, 'iteration')}. Then"


def _deed(deed: Departure) -> str:
    """What comes next."""
    return f"B {deed.text}" if deed.place == 0 or deed.kind == "missing" else f"{_at(deed)} B {deed.text}"


def _at(departure: Departure) -> str:
    if departure.place == 0:
        return "before iteration 1"
    if departure.a is None or departure.b is None or departure.a == departure.b:
        return f"in iteration {departure.a or departure.b}"
    return f"in iteration {departure.a} (B's {departure.b})"


def legend(v: ComparisonSnapshot) -> str:
    """Which colour is which run."""
    end = link("end A/B", c.StopComparing(), "shows the open run alone again; B stays as a branch")
    return (
        f'<p class="sides" title="A is drawn solid, B as an outline"><span>{_side("A")} {cut(v.name_a, 250)}</span>'
        f"<span>{_side('B')} {cut(v.name_b, 250)}</span>{end}</p>"
    )


def _side(side: str) -> str:
    return f"{swatch(SIDE_COLORS[side])}<b>{side}</b>"


# Both at the moment that is shown.


def where(v: ComparisonSnapshot) -> str:
    """The line above the slider."""
    if v.pair is None:
        return f"before iteration 1 / {len(v.pairs)} moments"
    return f"moment {v.place} / {len(v.pairs)}: iteration {v.pair.n} of {v.focus}"


def now_table(v: ComparisonSnapshot) -> str:
    """Both runs at the moment shown."""
    what = "accepted" if v.which == "kept" else "best so far"
    now = {"A": v.now_a, "B": v.now_b}
    has_ended = {"A": v.pair is not None and v.pair.a is None, "B": v.pair is not None and v.pair.b is None}

    def cell(say: Callable[[Any], str]) -> Callable[[str], str]:
        return lambda side: NONE if now[side] is None else say(now[side])

    def error(pick: Callable[[PoseErrors], float], unit: str = "") -> Callable[[str], str]:
        return cell(lambda run: number(pick(run.errors) if run.errors else None, 1, unit))

    columns: list[Column] = [
        (what.partition(" ")[0], f"the {what} pose of {v.focus} is drawn and measured here; ■ = no more of it comes",
         lambda side: f"{swatch(SIDE_COLORS[side])}{side}{' ■' * has_ended[side]}"),
        ("it.", "iteration that made this pose; 0 = an initial pose", cell(lambda run: f"{run.iteration}")),
        ("hyp.", "hypothesis that it belongs to", cell(lambda run: f"{run.arm + 1}")),
        ("stage", "what it was in that iteration", cell(lambda run: text(run.stage))),
        ("score", f"of the {what} pose, by the settings of its own run", cell(lambda run: number(run.score, 3))),
        ("rot.", "rotation error", error(lambda e: e.rotation_deg, "°")),
        ("mm", "translation error", error(lambda e: e.translation_mm)),
        ("ADD(-S)", "error of the pose that is drawn [mm]", error(lambda e: e.add_s_mm)),
    ]  # fmt: skip
    return table_of("AB", columns)


# The answers of both.


def outcome_table(v: ComparisonSnapshot) -> str:
    """The answers of both, object by object; click a row for its curves."""
    several = len(v.outcomes) > 1
    rows = [_outcome_row(v, o, marked=several and o.name == v.focus) for o in v.outcomes]
    if several:
        rows.append(_frame_row(v))
    head = [
        ("A → B", "the answers so far; click a row for the object's curves"),
        (f"score{'' if v.scores_alike else ' ⚠'}", "verification score of A → B, each by the settings of its own run"),
        ("ADD(-S)", "error against ground truth [mm], A → B"),
        ("rot.", "rotation error, A → B"),
        ("", "who is nearer to ground truth; without it, who scores higher, if both score alike"),
    ]
    return table(head, rows) + f'<p class="dim">{_effort(v.effort_a, v.effort_b)}</p>'


def _outcome_row(v: ComparisonSnapshot, o: Outcome, marked: bool) -> Row:
    def pair(pick: Callable[[ScoredBest], float | None], digits: int, unit: str = "") -> str:
        return _pair([None if x is None else pick(x) for x in (o.a, o.b)], digits, unit)

    def error(name: str, digits: int, unit: str = "") -> str:
        return pair(lambda answer: answer.errors and getattr(answer.errors, name), digits, unit)

    rescored = ""
    if not v.scores_alike and o.b is not None:
        rescored = f"each by its own settings, {NOT_COMPARABLE}; by those of A, B's answer scores {o.b.score:.2f}"
    winner = better(v, o)
    cells = [
        fitted(o.name),
        f'<span title="{text(rescored)}">{pair(lambda answer: answer.best.score.score, 2)}</span>',
        f'<span title="translation error: {error("translation_mm", 1)} mm">{error("add_s_mm", 1)}</span>',
        error("rotation_deg", 0, "°"),
        NONE if winner is None else "=" if winner == "even" else _side(winner),
    ]
    return Row(cells, Focus(o.instance_id), marked=marked)


def _frame_row(v: ComparisonSnapshot) -> Row:
    """All objects together, as the list of objects has them."""
    answered = [(o.a, o.b) for o in v.outcomes if o.a is not None and o.b is not None]
    means = [_mean_mm([answer.errors for answer in side]) for side in zip(*answered, strict=True)]
    return Row(
        [
            '<b title="all objects together">Frame</b>',
            f'<span title="frame score: {text(TERMS["frame score"])}">{_pair(v.frame_scores or (), 3)}</span>',
            f'<span title="mean over the objects">{_pair(means, 1)}</span>',
            "",
            "",
        ]
    )


def _mean_mm(errors: Sequence[PoseErrors | None]) -> float | None:
    known = [e.add_s_mm for e in errors if e is not None]
    return sum(known) / len(known) if known and len(known) == len(errors) else None


def _pair(values: Sequence[float | None], digits: int, unit: str = "") -> str:
    if all(x is None for x in values):
        return NONE
    return " → ".join(number(x, digits, unit) for x in values)


def _effort(a: Effort, b: Effort) -> str:
    """As in: 90 → 90 refiner calls; computing time 1204 → 1532 ms."""
    words = f"{a.refiner_calls} → {b.refiner_calls} refiner calls"
    if a.rollout_calls or b.rollout_calls:
        words += f" ({a.rollout_calls} → {b.rollout_calls} in roll-outs)"
    return f"{words}; computing time {a.ms:.0f} → {b.ms:.0f} ms"


def settings_list(v: ComparisonSnapshot) -> str:
    """What was set differently; after a change of preset only the first few."""
    if not v.settings:
        return '<p class="dim">Both have the same settings.</p>'
    most = 8
    lines = [text(f"{name}: {plain(one)} → {plain(other)}") for name, one, other in v.settings]
    shown, rest = lines[:most], lines[most:]
    if rest:
        shown.append(f'<span class="term" title="{"&#10;".join(rest)}">and {len(rest)} more</span>')
    return f'<p class="dim"><b>Settings of A → B</b><br>{"<br>".join(shown)}</p>'
