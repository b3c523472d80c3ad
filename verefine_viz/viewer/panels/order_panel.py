"""The Order panel: which objects depend on which, the order that follows, and changing it by hand."""

from __future__ import annotations

from collections.abc import Mapping

import viser

from verefine_viz.core.dependency import DependencyGraph, Edge
from verefine_viz.methods.registry import method_of
from verefine_viz.viewer.commands import CutDependency, ResetOrder
from verefine_viz.viewer.drawing.dependency_picture import TELLING, Node, full, picture
from verefine_viz.viewer.drawing.markup import link, sentence, text, warning
from verefine_viz.viewer.panels.widgets import Block, Send
from verefine_viz.viewer.snapshot.scene_state import color_of, labels_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import method_name

RULES = {
    "recommended": "It follows from what touches, hides and carries what.",
    "published": "It follows the authors' rule: masks that touch form a cluster, lower tops come first.",
    "given": "It was given by hand.",
}


class DependenciesPanel:
    """Words, the graph, and the evidence with links to cut it."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._block = Block(gui, "order")

    def show(self, snapshot: Snapshot) -> None:
        """The graph of the frame; it does not change during a run."""
        self._block.show(order_html(snapshot))


def order_html(snapshot: Snapshot) -> str:
    """The whole content of the panel."""
    graph, names = snapshot.problem.dependencies, labels_of(snapshot.problem)
    if len(names) < 2:
        return sentence("There is one object in this frame, and nothing to order.")
    if graph is None:
        return sentence("How the objects depend on each other was not looked at.")
    focus = None if snapshot.is_whole_scene else snapshot.target.instance.instance_id
    nodes = {
        i.instance_id: Node(names[i.instance_id], color_of(k), i.instance_id == focus)
        for k, i in enumerate(snapshot.problem.instances)
    }
    return "".join(
        (
            sentence(f"{order_sentence(graph, names, snapshot.session.method.name)} {RULES[graph.source]}"),
            picture(graph, nodes),
            _actions(snapshot, graph),
            *(_pair(edges, names) for edges in pairs(graph)),
            *(warning(f"{note[:1].upper()}{note[1:]}.") for note in graph.notes),
        )
    )


def order_sentence(graph: DependencyGraph, names: Mapping[int, str], method: str) -> str:
    """As in: Solved in 2 groups, in this order: tuna can; then bowl, sugar box. sugar box stands on bowl.

    Args:
        graph: whose order is described.
        names: by instance_id, in the order of the frame.
        method: by its name in a session file; one in which no object knows of the others does not follow the graph.
    """
    groups = [", ".join(names[i] for i in cluster) for cluster in graph.clusters]
    ordered = f"in {len(groups)} groups, " * (len(groups) > 1) + f"in this order: {'; then '.join(groups)}."
    said = f"Solved {ordered}"
    if not method_of(method).knows_others:
        said = (
            f"{method_name(method)} solves each object alone, in the order of the frame: {', '.join(names.values())}. "
            f"VF_b, VF_d and PHYSIM-MCTS would solve them {ordered}"
        )
    carried = [
        f"{' and '.join(names[i] for i in rest)} {'stands' if len(rest) == 1 else 'stand'} on {names[base]}"
        for base, *rest in graph.support_lists
        if rest and graph.source == "recommended" and _carries_all(graph, base, rest)
    ]
    return said + (f" {'; '.join(carried)}." if carried else "")


def pairs(graph: DependencyGraph) -> list[list[Edge]]:
    """Edges between the same two instances together, the most telling first."""
    found: dict[frozenset[int], list[Edge]] = {}
    for edge in sorted(graph.edges, key=lambda e: (TELLING[e.kind], e.first, e.second)):
        found.setdefault(frozenset((edge.first, edge.second)), []).append(edge)
    return list(found.values())


def _carries_all(graph: DependencyGraph, base: int, rest: list[int]) -> bool:
    direct = {e.second for e in graph.edges if e.kind == "support" and e.state == "used" and e.first == base}
    return set(rest) <= direct


def _actions(snapshot: Snapshot, graph: DependencyGraph) -> str:
    hint = '<span class="dim">▴ ▾ earlier, later. Moving and cutting restart the run.</span>'
    back = ""
    if graph.source == "given":
        back = " · " + link("back to the rule's order", ResetOrder(), "forget the given order; cuts stay")
    return f'<p style="margin-top:4px">{hint}{back}</p>'


def _pair(edges: list[Edge], names: Mapping[int, str]) -> str:
    """What is seen between two objects, and a link to cut or restore it."""
    first, second = edges[0].first, edges[0].second
    is_cut = edges[0].state == "cut"
    if is_cut:
        act = link("restore", CutDependency(first, second, False), "let it count again (restarts the run)")
    else:
        act = link("cut", CutDependency(first, second), "what is seen between the two is to count no more")
    said = ". ".join(text(full(e, names[e.first], names[e.second])) for e in edges)
    return f'<p class="{"dim" if is_cut else ""}" style="margin-bottom:4px;font-size:12px">{said}. {act}</p>'
