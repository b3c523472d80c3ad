"""How often the bandit has played each hypothesis, and what counts as a play."""

from __future__ import annotations

from verefine_viz.viewer.markup import text
from verefine_viz.viewer.view import View

N_MEANS = (
    "n_j, the plays that the bandit counted when it chose: the score of the first pose is one of them, and part of the "
    "mean μ_j. The Pulls curves count choices only, up to and with this iteration."
)
TIME_MEANS = (
    "computing time of all its plays so far, added up [ms]. The first play on an object also prepares it, once for all "
    "hypotheses and runs: the simulator gets its shape, the refiner its search structure. After a restart that is done."
)
WITH_UCB = ("rir", "vf_breadth", "vf_depth")
"""Methods whose choice depends on c."""
CHOOSING = (*WITH_UCB, "even", "expl")
"""Methods that choose between hypotheses."""
BEST_OF_ALL = ("rir", "vf_breadth", "even", "expl")
"""Methods whose answer is the pose with the highest score of any hypothesis; vf_depth looks at the whole scene's."""


def plays_text(plays: float) -> str:
    """A count of plays, which may be discounted."""
    return f"{plays:.0f}" if plays == round(plays) else f"{plays:.2f}"


def what_n_counts(view: View) -> str:
    """A line below a table of plays, which are not the pulls of the curves; empty where nothing is chosen."""
    if view.session.method.name not in CHOOSING:
        return ""
    said = "n: 1 for the score of the first pose, and 1 for each pull before this choice"
    if view.session.method.name == "vf_depth" and view.session.method.discount < 1:
        said += f"; earlier ones fade, ×{view.session.method.discount:g} a pass"
    return f'<p class="legend dim" title="{text(N_MEANS)}">{text(said)}.</p>'


def what_the_time_holds(view: View) -> str:
    """A line below a table of times, where the object's first play is among them."""
    if not any(i.index <= view.cursor for i in view.own_iterations):
        return ""
    j = view.own_iterations[0].arm + 1
    said = f"Σ ms: all plays together; the first, on hypothesis {j}, also prepares the object, once."
    return f'<p class="legend dim" title="{text(TIME_MEANS)}">{text(said)}</p>'
