"""A comparison in plain words and in tables. Plain text from :func:`summary`; names in tables are escaped here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from verefine_viz.core.palette import SIDE_COLORS
from verefine_viz.session.comparison import Answer, Difference, Effort, Outcome, tally
from verefine_viz.viewer import side_commands as s
from verefine_viz.viewer.commands import Focus
from verefine_viz.viewer.markup import Row, link, swatch, table, text
from verefine_viz.viewer.side_view import SideNow, SidesView
from verefine_viz.viewer.tables import number

_NONE = "–"


def summary(v: SidesView) -> str:
    """Where B parts from A, and how it ends."""
    return f"{_parting(v)} {_ending(v)}"


def _parting(v: SidesView) -> str:
    a, b, deed, score = f"A ({v.name_a})", f"B ({v.name_b})", v.differences.deed, v.differences.score
    made = min(v.effort_a.iterations, v.effort_b.iterations)
    if deed is None and score is None:
        if made == 0:
            return f"{a} and {b} start from the same poses."
        return f"{a} and {b} did the same in all {made} iterations that both have made, bit for bit."
    if deed is None:
        assert score is not None
        return f"{b} does the same as {a}, but {_at(score)} it {score.text}."
    said = f"{b} leaves {a} {_at(deed)}: it {deed.text}."
    if score is not None and score.place < deed.place and not v.scores_alike:
        said += " Their scores follow different rules."
    return said


def _at(difference: Difference) -> str:
    if difference.place == 0:
        return "before iteration 1"
    if difference.a is None or difference.b is None or difference.a == difference.b:
        return f"at iteration {difference.a or difference.b}"
    return f"at iteration {difference.a} (its own {difference.b})"


def _ending(v: SidesView) -> str:
    when = _when(v)
    known = [o for o in v.outcomes if o.winner is not None]
    if not known:
        return f"{when} neither has an answer for the same object."
    if len(v.outcomes) == 1:
        o = known[0]
        assert o.a is not None
        assert o.b is not None
        verdict = {"A": "A is nearer", "B": "B is nearer", "even": "they are even"}
        by_score = {"A": "A scores higher", "B": "B scores higher", "even": "they are even"}
        said = (verdict if o.a.errors is not None else by_score)[o.winner or "even"]
        return f"{when} A {_short(o.a)}, B {_short(o.b)}: {said}."
    wins = tally(v.outcomes)
    means = [_mean(known, side) for side in ("a", "b")]
    # Without ground truth nobody knows who is nearer.
    better = "scoring higher" if all(o.a is not None and o.a.errors is None for o in known) else "nearer"
    said = f"{when} A has {wins['A']} of {len(known)} objects {better}, B {wins['B']}"
    said += f", {wins['even']} even" if wins["even"] else ""
    if None not in means:
        said += f"; mean ADD(-S) A {means[0]:.1f} mm, B {means[1]:.1f} mm"
    if v.scene_scores is not None:
        said += f"; scene score A {v.scene_scores[0]:.3f}, B {v.scene_scores[1]:.3f}"
    return f"{said}."


def _when(v: SidesView) -> str:
    a, b = v.effort_a, v.effort_b
    if a.iterations >= a.planned and b.iterations >= b.planned:
        return "At the end"
    return f"So far (A {a.iterations} of {a.planned} iterations, B {b.iterations} of {b.planned})"


def _short(answer: Answer) -> str:
    error = f" / {answer.errors.add_s_mm:.1f} mm" if answer.errors is not None else ""
    return f"{answer.score:.2f}{error}"


def _mean(known: Sequence[Outcome], side: str) -> float | None:
    errors = [getattr(o, side).errors for o in known]
    return None if any(e is None for e in errors) else sum(e.add_s_mm for e in errors) / len(errors)


def legend(v: SidesView) -> str:
    """Which colour is which run."""
    a, b = swatch(SIDE_COLORS["A"]), swatch(SIDE_COLORS["B"])
    return (
        f"<p>{a}<b>A</b> {cut_name(v.name_a)}, solid; {b}<b>B</b> {cut_name(v.name_b)}, outline; "
        f"{link('end A/B', s.StopComparing(), 'shows the open run alone again; B stays as a branch')}</p>"
    )


def cut_name(name: str) -> str:
    """A run's name, cut where it is long."""
    return f'<span class="cut" style="max-width:130px" title="{text(name)}">{text(name)}</span>'


def where(v: SidesView) -> str:
    """The line above the slider."""
    if v.moment is None:
        return f"before iteration 1 / {len(v.timeline)} moments"
    m = v.moment
    calls = f"{m.calls} refiner call{'s' if m.calls != 1 else ''} on {v.focus}"
    sides = [f"A {_index(m.a)}", f"B {_index(m.b)}"]
    return f"moment {v.place} / {len(v.timeline)}: after {calls}, {', '.join(sides)}"


def _index(k: int | None) -> str:
    return "has no more" if k is None else f"iteration {k}"


def now_table(v: SidesView) -> str:
    """Both runs at the moment shown."""
    what = "kept" if v.which == "kept" else "best so far"
    head = [
        (f"{v.focus}", "the object in focus at this moment"), ("hyp.", "hypothesis that was worked on"),
        ("kept", "stage that was kept"), ("score", f"of the {what} pose that is drawn, by its own rule"),
        ("rot.", "rotation error"), ("mm", "translation error"), ("ADD(-S)", "error of the pose that is drawn [mm]"),
    ]  # fmt: skip
    rows = [_now_row("A", v.now_a), _now_row("B", v.now_b)]
    return f"<p><b>At this moment</b>, {text(what)}</p>" + table(head, rows)


def _now_row(side: str, now: SideNow | None) -> Row:
    mark = f"{swatch(SIDE_COLORS[side])}{side}"
    if now is None:
        return Row([mark, *[_NONE] * 6])
    i, e = now.iteration, now.errors
    return Row(
        [
            mark,
            _NONE if i is None else f"{i.arm + 1}",
            "initial" if i is None else text(i.accepted),
            number(now.score, 3),
            number(e.rotation_deg if e else None, 1, "°"),
            number(e.translation_mm if e else None, 1),
            number(e.add_s_mm if e else None, 1),
        ]
    )


def outcome_table(v: SidesView) -> str:
    """The answers of both, object by object; click a row for its curves."""
    rows: list[Row] = []
    for o in v.outcomes:
        a, b = o.a, o.b
        cells = [
            f'<span title="{text(o.name)}">{text(o.name)}</span>',
            _pair(a, b, lambda x: x.score, 2),
            f'<span title="{_offsets(a, b)}">{_pair(a, b, lambda x: x.errors and x.errors.add_s_mm, 1)}</span>',
            _pair(a, b, lambda x: x.errors and x.errors.rotation_deg, 0, "°"),
            {"A": _winner("A"), "B": _winner("B"), "even": "=", None: _NONE}[o.winner],
        ]
        rows.append(Row(cells, Focus(o.instance_id), marked=o.name == v.focus and len(v.outcomes) > 1))
    rule = "" if v.scores_alike else " Both by the rule of A, since B scores differently."
    head = [
        ("A → B", "the answers so far; click a row for the object's curves"),
        ("score", f"verification score of A → B.{rule}"),
        ("ADD(-S)", "error against ground truth [mm], A → B"),
        ("rot.", "rotation error, A → B"),
        ("", "who is nearer to ground truth; without it, who scores higher"),
    ]
    return table(head, rows) + _totals(v)


def _totals(v: SidesView) -> str:
    a, b = v.effort_a, v.effort_b
    rows: list[Row] = []
    if v.scene_scores is not None:
        one, other = v.scene_scores
        rows.append(Row(["scene score", f"{one:.3f}", f"{other:.3f}", f"{other - one:+.3f}"]))
    rows.append(_effort_row("refiner calls", a, b, lambda e: e.refiner_calls))
    if a.rollout_calls or b.rollout_calls:
        rows.append(_effort_row("… in roll-outs", a, b, lambda e: e.rollout_calls))
    rows.append(Row(["computing time", f"{a.ms:.0f} ms", f"{b.ms:.0f} ms", f"{b.ms - a.ms:+.0f} ms"]))
    rows.append(Row(["iterations", f"{a.iterations} / {a.planned}", f"{b.iterations} / {b.planned}", ""]))
    head = [("whole frame", "all objects together"), ("A", ""), ("B", ""), ("B − A", "")]
    return table(head, rows)


def _effort_row(label: str, a: Effort, b: Effort, pick: Any) -> Row:
    return Row([label, f"{pick(a)}", f"{pick(b)}", f"{pick(b) - pick(a):+d}"])


def _offsets(a: Answer | None, b: Answer | None) -> str:
    """What there is no column for."""
    return f"translation error: {_pair(a, b, lambda x: x.errors and x.errors.translation_mm, 1)} mm"


def _winner(side: str) -> str:
    return f"{swatch(SIDE_COLORS[side])}<b>{side}</b>"


def _pair(a: Answer | None, b: Answer | None, pick: Any, digits: int, unit: str = "") -> str:
    values = [None if x is None else pick(x) for x in (a, b)]
    if values == [None, None]:
        return _NONE
    return " → ".join(number(x, digits, unit) for x in values)


def settings_list(v: SidesView) -> str:
    """What was set differently; after a change of preset only the first few."""
    if not v.settings:
        return '<p class="dim">Both have the same settings.</p>'
    most = 8
    lines = [f"{name}: {_value(one)} → {_value(other)}" for name, one, other in v.settings[:most]]
    more = f"<br>and {len(v.settings) - most} more" if len(v.settings) > most else ""
    return f'<p class="dim"><b>Settings of A → B</b><br>{"<br>".join(text(line) for line in lines)}{more}</p>'


def _value(value: Any) -> str:
    said = f"{value:g}" if isinstance(value, float) else str(value)
    return said if len(said) <= 40 else f"{said[:39]}…"
