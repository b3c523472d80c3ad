"""The comparison of the open run, A, with another one, B: how far B is to be computed, and both against each other."""

from __future__ import annotations

from dataclasses import dataclass, replace

from verefine_viz.session.comparison import Differences, Timeline, Trace, aligned, differences, trace_of
from verefine_viz.session.engine import Run
from verefine_viz.viewer.commands import Command
from verefine_viz.viewer.comparison_commands import RunB
from verefine_viz.viewer.state.branch import Branch, ComparisonChoice
from verefine_viz.viewer.state.view_options import ViewOptions
from verefine_viz.viewer.state.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Compared:
    """Two runs, as far as they are computed."""

    a: Trace
    b: Trace
    timeline: Timeline
    differences: Differences


class Comparison:
    """Two runs of the open frame, if two are looked at."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self.goal: tuple[Branch, int | None] | None = None
        """The branch that is computed and up to which length, None = to its end."""
        self._noted: tuple[Run, int] | None = None
        self._known: tuple[Run, int, Run, int, Compared] | None = None

    @property
    def is_running(self) -> bool:
        """Whether B is being computed."""
        return self.goal is not None

    @property
    def choice(self) -> ComparisonChoice | None:
        """What B is and how both are shown; None = the open run is looked at alone."""
        return self._workspace.work.comparison

    def branch_b(self) -> Branch | None:
        """The branch beside the open one."""
        choice, branches = self.choice, self._workspace.work.branches
        return branches[choice.b] if choice is not None and choice.b < len(branches) else None

    def progress(self) -> tuple[Command, ...]:
        """What the log has to say before the next command, since it may depend on how far B is."""
        if self.goal is None:
            return ()
        run, noted = self.goal[0].run, self._noted
        if run.length == 0 or (noted is not None and noted[0] is run and noted[1] == run.length):
            return ()
        self._noted = (run, run.length)
        return (RunB(run.length),)

    def visible(self, options: ViewOptions) -> ViewOptions:
        """``options`` without the layers that would hide the two runs."""
        return options if self.choice is None else replace(options, layers=options.layers - self.choice.hidden)

    def compared(self) -> Compared | None:
        """Both runs against each other; None while only one is looked at."""
        other = self.branch_b()
        if other is None:
            return None
        a, b = self._workspace.run, other.run
        known = self._known
        if known is not None and known[0] is a and known[2] is b and known[1] == a.length and known[3] == b.length:
            return known[4]
        one, two = trace_of(a), trace_of(b)
        timeline = aligned(one, two)
        compared = Compared(one, two, timeline, differences(one, two, timeline))
        self._known = (a, a.length, b, b.length, compared)
        return compared

    def place(self) -> int:
        """Where both are on their timeline; 0 before the first moment."""
        compared, choice, cursor = self.compared(), self.choice, self._workspace.run.cursor
        assert compared is not None
        assert choice is not None
        place = compared.timeline.place(choice.moment)
        if place is not None and compared.timeline.a_at(place) == cursor:
            return place
        if cursor == len(compared.a.iterations) and compared.a.is_done:
            return len(compared.timeline)
        return compared.timeline.of_a(cursor)
