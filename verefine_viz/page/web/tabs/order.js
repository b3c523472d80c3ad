// Which objects depend on which: the graph in the order to solve them, and changing that order.
import { html } from "htm/preact";
import { send, setView, useStore } from "../store.js";
import { momentOf } from "../moment.js";
import { Button, IconButton, Swatch } from "../ui.js";

/** @import { FrameObject, SolvingOrder } from "../messages.d.ts" */

export const title = "Order";
export const hint = "which objects rest on, hide or touch which, and the order that follows";
/** @param {import("../store.js").State} s */
export const needs = (s) => Boolean(s.frame?.order) && s.frame.objects.length > 1;
/** @param {import("../store.js").State} s */
export const empty = (s) => (s.frame?.objects.length > 1 ? "How the objects depend on each other is not known." : "One object: nothing to order.");

const RULES = {
  recommended: "The order follows from what touches, hides and carries what.",
  published: "The order follows the authors' rule: masks that touch form a cluster, lower tops come first.",
  given: "The order is given by the session.",
};
const KINDS = { support: "carries", occlusion: "hides", contact: "may touch" };
const TELLING = { support: 0, occlusion: 1, contact: 2 };
const STATES = { used: "", ambiguous: "runs in a circle, excluded from the order", cut: "cut" };
const [ROW, GAP, WIDTH, NODE] = [26, 10, 340, 172];

export function render() {
  const [order, objects, branch, branches] = useStore((s) => [s.frame.order, s.frame.objects, s.view.branch, s.branches]);
  const moment = useStore(momentOf);
  const method = useStore((s) => s.frame.method_label);
  const of = (id) => objects.find((o) => o.id === id) ?? { label: `object ${id}`, color: "#888" };
  const pairs = Object.values(Object.groupBy([...order.edges].sort((x, y) => TELLING[x.kind] - TELLING[y.kind]), (e) => [e.first, e.second].sort((x, y) => x - y).join()));
  const restarts = branches.length > 1 ? "restarts the run and discards the branches" : "restarts the run";
  return html`<div class="tab order">
    <p class="summary">${RULES[order.source]} ${new Set(objects.map((o) => o.cluster)).size <= order.clusters.length ? "" : `${method} solves each object alone; vf_breadth, vf_depth and physim_mcts follow this order.`}</p>
    ${order.notes.map((note) => html`<p class="doubt">${note[0].toUpperCase() + note.slice(1)}.</p>`)}
    <${Graph} order=${order} of=${of} current=${moment.obj} />
    <p class="key"><span><svg class="line" viewBox="0 0 24 8"><path d="M0 4h24" /></svg>carries</span><span><svg class="line" viewBox="0 0 24 8"><path class="occlusion" d="M0 4h24" /></svg>hides</span>
      <span><svg class="line" viewBox="0 0 24 8"><path class="contact" d="M0 4h24" /></svg>may touch</span></p>
    <table class="table"><tbody>${order.clusters.flatMap((cluster, c) => cluster.map((id, i) => {
      const [first, last] = [c === 0 && i === 0, c === order.clusters.length - 1 && i === cluster.length - 1];
      const move = (by) => send({ verb: "order", branch, move: [id, by] });
      return html`<tr key=${id} class=${`clickable ${id === moment.obj ? "current" : ""}`} onClick=${() => setView({ obj: id, arm: null })}>
        <td class="left">${order.clusters.slice(0, c).flat().length + i + 1}</td><td class="left"><${Swatch} color=${of(id).color} />${of(id).label}</td>
        <td onClick=${(e) => e.stopPropagation()}><${IconButton} engine icon="down" kind="flip" disabled=${first} title=${`solve it earlier; ${restarts}`} onClick=${() => move(-1)} />
          <${IconButton} engine icon="down" disabled=${last} title=${`solve it later; ${restarts}`} onClick=${() => move(1)} /></td></tr>`;
    }))}</tbody></table>
    ${order.source === "given" && html`<div class="row"><${Button} engine title="forget the given order; cuts stay" onClick=${() => send({ verb: "order", branch, reset: true })}>Back to the rule's order<//></div>`}
    ${pairs.length > 0 && html`<h3>Evidence</h3>`}
    ${pairs.map((edges) => {
      const [{ first, second, state: is }] = edges;
      const cut = is === "cut";
      return html`<div class=${`evidence ${cut ? "cut" : ""}`} key=${`${first} ${second}`}><div>${edges.map((e) => html`<p><${Swatch} color=${of(e.first).color} />${of(e.first).label} ${
        e.kind === "contact" ? html`and <${Swatch} color=${of(e.second).color} />${of(e.second).label} may touch` : html`${KINDS[e.kind]} <${Swatch} color=${of(e.second).color} />${of(e.second).label}`}: ${e.evidence}${
        STATES[e.state] && html`<span class="dim">; ${STATES[e.state]}</span>`}</p>`)}</div>
        <${Button} engine title=${cut ? `let it count again; ${restarts}` : `what is seen between the two counts no more; ${restarts}`} onClick=${() => send({ verb: "order", branch, cut: [first, second, !cut] })}>${cut ? "Restore" : "Cut"}<//></div>`;
    })}
  </div>`;
}

/**
 * The objects from top to bottom in the order to solve them, in their clusters; edges are arcs beside them.
 * @param {{ order: SolvingOrder, of: (id: number) => Pick<FrameObject, "label" | "color">, current: number }} props
 */
function Graph({ order, of, current }) {
  const y = new Map();
  let at = ROW / 2 + 3;
  for (const cluster of order.clusters) {
    for (const id of cluster) y.set(id, at), (at += ROW);
    at += GAP;
  }
  const carried = new Set(order.edges.filter((e) => e.kind === "support").map((e) => [e.first, e.second].sort().join()));
  const drawn = order.edges.filter((e) => y.has(e.first) && y.has(e.second) && (e.kind !== "contact" || !carried.has([e.first, e.second].sort().join())))
    .sort((a, b) => TELLING[a.kind] - TELLING[b.kind]);
  const longest = Math.max(1, ...drawn.map((e) => Math.abs(y.get(e.first) - y.get(e.second))));
  const arcs = drawn.map((e) => {
    const down = y.get(e.second) > y.get(e.first) ? 1 : -1;
    const inset = 4.5 - 4 * TELLING[e.kind];
    const [from, to] = [y.get(e.first) + down * inset, y.get(e.second) - down * inset];
    return { e, from, to, bulge: NODE + 26 + ((WIDTH - NODE - 90) * Math.abs(to - from)) / longest };
  });
  const titleOf = (e) => `${of(e.first).label} ${KINDS[e.kind]} ${of(e.second).label}: ${e.evidence}${STATES[e.state] ? `; ${STATES[e.state]}` : ""}`;
  // Numbers come last: no arc crosses them.
  return html`<svg class="graph" viewBox=${`0 0 ${WIDTH} ${at}`}>
    ${order.clusters.map((cluster, k) => html`<rect class="cluster" x="0.5" y=${y.get(cluster[0]) - ROW / 2} width=${NODE} height=${ROW * cluster.length} rx="4">
      <title>cluster ${k + 1} of ${order.clusters.length}: what may interact is solved together</title></rect>`)}
    ${[...y].map(([id, top]) => html`<g class=${`node ${id === current ? "current" : ""}`} onClick=${() => setView({ obj: id, arm: null })}>
      <rect class="hit" x="1" y=${top - ROW / 2} width=${NODE - 2} height=${ROW} /><rect x="10" y=${top - 5} width="10" height="10" rx="2" fill=${of(id).color} />
      <text x="27" y=${top + 4}>${of(id).label.length > 21 ? `${of(id).label.slice(0, 20)}…` : of(id).label}</text><title>${of(id).label}</title></g>`)}
    ${arcs.map(({ e, from, to, bulge }) => html`<g class=${`edge ${e.kind} ${e.state}`}><path class=${e.kind} d=${`M${NODE + 2} ${from}C${bulge} ${from} ${bulge} ${to} ${NODE + 8} ${to}`} />
        ${e.kind !== "contact" && html`<polygon points=${`${NODE + 2},${to} ${NODE + 10},${to - 4} ${NODE + 10},${to + 4}`} />`}
        <title>${titleOf(e)}</title></g>`)}
    ${arcs.map(({ e, from, to, bulge }) => html`<g class=${`edge ${e.kind} ${e.state}`}>
        <text x=${NODE + 14 + 0.75 * (bulge - NODE)} y=${(from + to) / 2 + 4}>${/^[\d.]+ ?(%|mm)/.exec(e.evidence)?.[0] ?? ""}${e.state === "ambiguous" ? " ⟲" : ""}</text>
        <title>${titleOf(e)}</title></g>`)}
  </svg>`;
}
