"""A comparison of two runs in plain words and in tables. Names in tables are escaped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from verefine_viz.core.palette import SIDE_COLORS
from verefine_viz.session.comparison import Difference
from verefine_viz.session.outcomes import Answer, Effort, Outcome, Winner, tally
from verefine_viz.viewer import comparison_commands as s
from verefine_viz.viewer.commands import Focus
from verefine_viz.viewer.drawing.markup import Row, cut, fitted, link, number, swatch, table, text, warning
from verefine_viz.viewer.drawing.pose_tables import NOT_COMPARABLE
from verefine_viz.viewer.snapshot.comparison import ComparisonSnapshot, RunAtMoment
from verefine_viz.viewer.text.display_names import TERMS

# Scores of two runs side by side: what they tell where both score by the same settings, and where they do not.


def better(v: ComparisonSnapshot, o: Outcome) -> Winner | None:
    """Who has an object nearer to ground truth, or scores it higher; None where neither can be said."""
    return o.winner if v.scores_alike or _is_known(o) else None


def has_both(o: Outcome) -> bool:
    """Whether both runs have an answer for an object."""
    return o.a is not None and o.b is not None


def own_score(answer: Answer) -> float:
    """Of an answer, by the settings of its own run."""
    return answer.best.score.score


def scores_note(v: ComparisonSnapshot) -> str:
    """A box above scores that do not compare; empty where they do."""
    found = _rules(v)
    if not found:
        return ""
    said = "; ".join(f"{name} is {plain(one)} in A, {plain(other)} in B" for name, one, other in found)
    instead = (
        "Errors against ground truth are."
        if any(_is_known(o) for o in v.outcomes)
        else "Without ground truth nothing here says which is better: give both the same."
    )
    return warning(f"Scores of A and B are {NOT_COMPARABLE}: {said}. {instead}")


def score_sign(v: ComparisonSnapshot) -> str:
    """A sign behind the heading of scores that do not compare."""
    return "" if v.scores_alike else " ⚠"


def rescored_by_a(v: ComparisonSnapshot, o: Outcome) -> str:
    """A tooltip: B's answer by the settings of A, where B scores by others."""
    if v.scores_alike or o.b is None:
        return ""
    return text(f"each by its own settings, {NOT_COMPARABLE}; by those of A, B's answer scores {o.b.score:.2f}")


def plain(value: Any) -> str:
    """The value of a setting, cut where it is long."""
    said = f"{value:g}" if isinstance(value, float) else str(value)
    return said if len(said) <= 40 else f"{said[:39]}…"


def _rules(v: ComparisonSnapshot) -> tuple[tuple[str, Any, Any], ...]:
    """The settings of the score that differ: (dotted name, of A, of B)."""
    if v.scores_alike:
        return ()
    # Two renderers of one rule agree to the last digits that matter.
    return tuple(s for s in v.settings if s[0].startswith("score.") and s[0] != "score.renderer")


def _is_known(o: Outcome) -> bool:
    """Whether ground truth says how far off both are."""
    return o.a is not None and o.b is not None and o.a.errors is not None and o.b.errors is not None


_NONE = "–"


def summary(v: ComparisonSnapshot) -> str:
    """Where both part, and how it ends."""
    return f"{_parting(v)} {_ending(v)}"


def _parting(v: ComparisonSnapshot) -> str:
    a, b, deed, score = f"A ({v.name_a})", f"B ({v.name_b})", v.differences.deed, v.differences.score
    made = min(v.effort_a.iterations, v.effort_b.iterations)
    if deed is None and score is None:
        if made == 0:
            return f"{a} and {b} start from the same poses."
        return f"{a} and {b} did the same in all {made} iterations that both have made, bit for bit."
    if deed is None:
        assert score is not None
        return f"{a} and {b} reach the same poses, but judge them differently: {_at(score)}, B {score.text}."
    return f"{a} and {b} {_until(deed)} {_deed(v, deed)}."


def _until(deed: Difference) -> str:
    """Up to where both do the same."""
    if deed.place == 0:
        return "begin differently:"
    if deed.place == 1:
        return "part at once:"
    n = deed.place - 1
    return f"do the same for {n} iteration{'s' if n > 1 else ''}. Then"


def _deed(v: ComparisonSnapshot, deed: Difference) -> str:
    """What comes next."""
    if deed.place == 0:
        return f"B {deed.text}"
    if deed.kind != "missing":
        return f"{_at(deed)} B {deed.text}"
    name = next((o.name for o in v.outcomes if o.instance_id == deed.instance_id), "an object")
    n = v.timeline.moments[deed.place - 1].calls - 1
    ended, other = ("B", "A") if deed.b is None else ("A", "B")
    return f"{ended} is done with {name} after {n} refiner call{'s' if n != 1 else ''}, while {other} goes on"


def _at(difference: Difference) -> str:
    if difference.place == 0:
        return "before iteration 1"
    if difference.a is None or difference.b is None or difference.a == difference.b:
        return f"in iteration {difference.a or difference.b}"
    return f"in iteration {difference.a} (B's {difference.b})"


def _ending(v: ComparisonSnapshot) -> str:
    when = _when(v)
    answered, known = [o for o in v.outcomes if has_both(o)], [o for o in v.outcomes if better(v, o) is not None]
    if not answered:
        return f"{when} neither has an answer for the same object."
    if not known:  # Scores by different settings, and no ground truth.
        return f"{when} nothing says which is better."
    if len(v.outcomes) == 1:
        o = known[0]
        assert o.a is not None
        assert o.b is not None
        if o.a.errors is None or o.b.errors is None:
            higher = {"A": "A scores higher", "B": "B scores higher", "even": "they score the same"}
            return f"{when} {higher[o.winner or 'even']}: A {o.a.score:.2f}, B {o.b.score:.2f}."
        nearer = {
            "A": "A is nearer to ground truth",
            "B": "B is nearer to ground truth",
            "even": "they are equally near",
        }
        said, off_a, off_b = f"{when} {nearer[o.winner or 'even']}", o.a.errors.add_s_mm, o.b.errors.add_s_mm
        if not v.scores_alike:
            return f"{said}: A is {off_a:.1f} mm off, B {off_b:.1f} mm."
        return f"{said}: A is {off_a:.1f} mm off and scores {o.a.score:.2f}, B {off_b:.1f} mm and {o.b.score:.2f}."
    wins = tally(known)
    # Without ground truth it is unknown who is nearer.
    blind = all(o.a is not None and o.a.errors is None for o in known)
    said = (
        f"{when} A {'scores higher' if blind else 'is nearer to ground truth'} on {wins['A']} of {len(known)} objects, "
    )
    said += f"B on {wins['B']}" + (f", {wins['even']} are even" if wins["even"] else "")
    return f"{said}."


def _when(v: ComparisonSnapshot) -> str:
    a, b = v.effort_a, v.effort_b
    if a.iterations >= a.planned and b.iterations >= b.planned:
        return "At the end"
    return f"So far (A {a.iterations} of {a.planned} iterations, B {b.iterations} of {b.planned})"


def _mean(known: Sequence[Outcome], side: str) -> float | None:
    errors = [getattr(o, side).errors for o in known]
    return None if not errors or None in errors else sum(e.add_s_mm for e in errors) / len(errors)


def legend(v: ComparisonSnapshot) -> str:
    """Which colour is which run."""
    a, b = swatch(SIDE_COLORS["A"]), swatch(SIDE_COLORS["B"])
    return (
        f"<p>{a}<b>A</b> {cut(v.name_a, 130)}, solid; {b}<b>B</b> {cut(v.name_b, 130)}, outline; "
        f"{link('end A/B', s.StopComparing(), 'shows the open run alone again; B stays as a branch')}</p>"
    )


def where(v: ComparisonSnapshot) -> str:
    """The line above the slider."""
    if v.moment is None:
        return f"before iteration 1 / {len(v.timeline)} moments"
    m = v.moment
    calls = f"{m.calls} refiner call{'s' if m.calls != 1 else ''} on {v.focus}"
    return f"moment {v.place} / {len(v.timeline)}: after {calls}"


def now_table(v: ComparisonSnapshot) -> str:
    """Both runs at the moment shown."""
    what = "kept" if v.which == "kept" else "best so far"
    head = [
        (what.partition(" ")[0], f"the {what} pose of {v.focus} is drawn and measured here; ■ = no more of it comes"),
        ("it.", "iteration that made this pose; 0 = a initial pose"),
        ("hyp.", "hypothesis that it belongs to"), ("stage", "what it was in that iteration"),
        ("score", f"of the {what} pose, by the settings of its own run"),
        ("rot.", "rotation error"), ("mm", "translation error"), ("ADD(-S)", "error of the pose that is drawn [mm]"),
    ]  # fmt: skip
    ended = [v.moment is not None and k is None for k in ((v.moment.a, v.moment.b) if v.moment else (None, None))]
    rows = [_now_row("A", v.now_a, ended[0]), _now_row("B", v.now_b, ended[1])]
    return table(head, rows)


def _now_row(side: str, now: RunAtMoment | None, has_ended: bool) -> Row:
    mark = f"{swatch(SIDE_COLORS[side])}{side}{' ■' if has_ended else ''}"
    if now is None:
        return Row([mark, *[_NONE] * 7])
    e = now.errors
    return Row(
        [
            mark,
            f"{now.iteration}",
            f"{now.arm + 1}",
            text(now.stage),
            number(now.score, 3),
            number(e.rotation_deg if e else None, 1, "°"),
            number(e.translation_mm if e else None, 1),
            number(e.add_s_mm if e else None, 1),
        ]
    )


def outcome_table(v: ComparisonSnapshot) -> str:
    """The answers of both, object by object; click a row for its curves."""
    rows: list[Row] = []
    for o in v.outcomes:
        a, b = o.a, o.b
        cells = [
            fitted(o.name),
            f'<span title="{rescored_by_a(v, o)}">{_pair(a, b, own_score, 2)}</span>',
            f'<span title="{_offsets(a, b)}">{_pair(a, b, lambda x: x.errors and x.errors.add_s_mm, 1)}</span>',
            _pair(a, b, lambda x: x.errors and x.errors.rotation_deg, 0, "°"),
            {"A": _winner("A"), "B": _winner("B"), "even": "=", None: _NONE}[better(v, o)],
        ]
        rows.append(Row(cells, Focus(o.instance_id), marked=o.name == v.focus and len(v.outcomes) > 1))
    if len(v.outcomes) > 1:
        rows.append(_frame_row(v))
    head = [
        ("A → B", "the answers so far; click a row for the object's curves"),
        (f"score{score_sign(v)}", "verification score of A → B, each by the settings of its own run"),
        ("ADD(-S)", "error against ground truth [mm], A → B"),
        ("rot.", "rotation error, A → B"),
        ("", "who is nearer to ground truth; without it, who scores higher, if both score alike"),
    ]
    return table(head, rows) + f'<p class="dim">{_effort(v.effort_a, v.effort_b)}</p>'


def _frame_row(v: ComparisonSnapshot) -> Row:
    """All objects together, as the list of objects has them."""
    errors = [_mean([o for o in v.outcomes if has_both(o)], side) for side in ("a", "b")]
    scores = v.frame_scores or (None, None)
    return Row(
        [
            '<b title="all objects together">Frame</b>',
            f'<span title="frame score: {text(TERMS["frame score"])}">{_two(scores, 3)}</span>',
            f'<span title="mean over the objects">{_two(errors, 1)}</span>',
            "",
            "",
        ]
    )


def _effort(a: Effort, b: Effort) -> str:
    """As in: 90 → 90 refiner calls; computing time 1204 → 1532 ms."""
    said = f"{a.refiner_calls} → {b.refiner_calls} refiner calls"
    if a.rollout_calls or b.rollout_calls:
        said += f" ({a.rollout_calls} → {b.rollout_calls} in roll-outs)"
    return f"{said}; computing time {a.ms:.0f} → {b.ms:.0f} ms"


def _offsets(a: Answer | None, b: Answer | None) -> str:
    """What there is no column for."""
    return f"translation error: {_pair(a, b, lambda x: x.errors and x.errors.translation_mm, 1)} mm"


def _winner(side: str) -> str:
    return f"{swatch(SIDE_COLORS[side])}<b>{side}</b>"


def _pair(a: Answer | None, b: Answer | None, pick: Any, digits: int, unit: str = "") -> str:
    return _two([None if x is None else pick(x) for x in (a, b)], digits, unit)


def _two(values: Sequence[float | None], digits: int, unit: str = "") -> str:
    if all(x is None for x in values):
        return _NONE
    return " → ".join(number(x, digits, unit) for x in values)


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
