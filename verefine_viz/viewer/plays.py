"""How often the bandit has played each hypothesis, and what counts as a play."""

from __future__ import annotations

from verefine_viz.viewer.markup import text
from verefine_viz.viewer.view import View

N_MEANS = (
    "n_j, the plays that the bandit counted when it chose: the first pose is one of them, and its score part of the "
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
    said = "n: 1 for the first pose, and 1 for each pull before this choice"
    if any(edit.instance == view.target.instance.instance_id for edit in view.edits):
        said += "; a pose moved by hand begins anew at 1"
    if view.session.method.name == "vf_depth" and view.session.method.discount < 1:
        said += f"; earlier ones fade, ×{view.session.method.discount:g} a pass"
    return f'<p class="legend dim" title="{text(N_MEANS)}">{text(said)}.</p>'


def mean_of(view: View) -> str:
    """What μ is the mean of, for a tooltip."""
    if not _counts_scenes(view):
        return "μ_j, mean over the plays: the score of the first pose, and of each play the highest of its poses"
    method = view.session.method
    at = "its poses" if method.scene_reward == "current_pass" else "the best pose of each object so far"
    said = (
        f"μ_j, mean over the plays. Each pass counts for the hypotheses it chose: the score of {_whole(view)} at {at}"
    )
    if _took_over(view):
        return f"{said}. Plays before vf_depth took over count the object's own score."
    if method.scene_prior == "object":
        return f"{said}. The first play counts the score of the object's first pose alone."
    return f"{said}. The first play counts that score with this first pose and the best first poses of the others."


def what_the_mean_is_of(view: View) -> str:
    """A line below a table of plays, where μ is of more than the object; empty elsewhere."""
    if not _counts_scenes(view):
        return ""
    said = f"μ: mean score of {_whole(view)}, not of this object alone as “best” is"
    if not _took_over(view):
        alone = view.session.method.scene_prior == "object"
        said += f"; first play: {'this first pose alone' if alone else 'together with this first pose'}"
    return f'<p class="legend dim" title="{text(mean_of(view))}">{text(said)}.</p>'


def _counts_scenes(view: View) -> bool:
    """Whether the scores of whole scenes reward the hypotheses of the object in focus."""
    if view.session.method.name != "vf_depth":
        return False
    cluster = view.scene.object(view.target.instance.instance_id).cluster
    return sum(o.cluster == cluster and bool(o.target.instance.hypotheses) for o in view.scene.objects) > 1


def _whole(view: View) -> str:
    """The scene whose score is counted."""
    if view.scene.n_clusters < 2:
        return "all objects together"
    return f"cluster {view.scene.object(view.target.instance.instance_id).cluster} as a whole"


def _took_over(view: View) -> bool:
    """Whether another method began the run."""
    return any(
        change.after_iteration and "name" in change.settings.get("method", {}) for change in view.session.changes
    )


def what_the_time_holds(view: View) -> str:
    """A line below a table of times, where the object's first play is among them."""
    if not any(i.index <= view.cursor for i in view.own_iterations):
        return ""
    j = view.own_iterations[0].arm + 1
    said = f"Σ ms: all plays together; the first, on hypothesis {j}, also prepares the object, once."
    return f'<p class="legend dim" title="{text(TIME_MEANS)}">{text(said)}</p>'
