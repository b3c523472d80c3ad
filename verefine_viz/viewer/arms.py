"""Hypotheses as the page shows them: number, colour, and where each comes from."""

from __future__ import annotations

import re
from itertools import groupby

from verefine_viz.core.palette import ARM_COLORS, RGB
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.viewer.long_names import told_apart
from verefine_viz.viewer.markup import swatch, text


def arm_color(j: int) -> RGB:
    """The colour of hypothesis ``j``, from 0."""
    return ARM_COLORS[j % len(ARM_COLORS)]


def arm_name(target: Target, j: int) -> str:
    """As in: hypothesis 2 (cosypose). Plain text; without the source where all have the same."""
    said = f"hypothesis {j + 1}"
    return f"{said} ({source_of(target.instance.hypotheses[j])})" if have_names(target) else said


def source_of(hypothesis: Hypothesis) -> str:
    """Where it comes from, without the number that disturbed poses have."""
    return re.sub(r" #\d+$", "", hypothesis.source)


def have_names(target: Target) -> bool:
    """Whether it tells hypotheses apart where they come from."""
    return len({source_of(h) for h in target.instance.hypotheses}) > 1


def arms_legend(target: Target, brief: bool = False) -> str:
    """A swatch per hypothesis, and behind those of one source its name; "all …" where there is but one.

    ``brief``: without the words that all names begin with.
    """
    numbered = enumerate(target.instance.hypotheses)
    groups = [(source, [j for j, _ in group]) for source, group in groupby(numbered, lambda pair: source_of(pair[1]))]
    every = "" if have_names(target) or len(target.instance.hypotheses) < 2 else "all "
    names = [source for source, _ in groups]
    return " ".join(
        f'<span style="white-space:nowrap" title="{text(source)}">'
        f"{' '.join(f'{swatch(arm_color(j))}{j + 1}' for j in group)} "
        f'<span class="cut" style="max-width:290px">{every}{text(name)}</span></span>'
        for (source, group), name in zip(groups, told_apart(names) if brief else names, strict=True)
    )
