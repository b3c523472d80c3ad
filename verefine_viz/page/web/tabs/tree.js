// The tree of a tree search: a layer per object, a box per node; built up from the rows, drawn as SVG.
import { html } from "htm/preact";
import { useMemo } from "preact/hooks";
import { useStore } from "../store.js";
import { seek } from "../cursor.js";
import { palette } from "../palette.js";
import { Chart } from "../charts.js";
import { columnsOf, counted, number, Swatch, Table } from "../ui.js";

/** @import { IterationRow, SearchNode } from "../messages.d.ts" */
/** @import { Moment } from "../moment.js" */

/** @typedef {Pick<SearchNode, "obj" | "arm" | "lcp"> & { k: number }} Added  a node as it was added, in iteration k */
/**
 * @typedef {Added & { number: number, parent: number, depth: number, visits: number, cost: number, mean: number,
 *   children: number[] }} TreeNode
 */
/** @typedef {NonNullable<ReturnType<typeof treeAt>>} Searched */

const CHEAP = [53, 183, 121];
const DEAR = [68, 40, 90];
const INCUMBENT = "#f0c83c";
const [WIDTH, LAYER, GAP, STRIP, NARROWEST, WITH_VISITS] = [340, 24, 2, 6, 30, 56];

/**
 * Nodes by number with visits and costs after iteration k; null where no iteration of the cluster searched.
 * @param {IterationRow[]} rows
 * @param {number} k
 * @param {number} cluster
 */
export function treeAt(rows, k, cluster) {
  const steps = rows.filter((row) => row.k <= k && row.tree && row.tree.cluster === cluster);
  if (!steps.length) return null;
  /** @type {(number: number, parent: number, depth: number, rest: Added) => TreeNode} */
  const node = (number, parent, depth, rest) => ({ number, parent, depth, visits: 0, cost: 0, mean: Infinity, children: [], ...rest });
  const nodes = [node(0, -1, 0, { obj: null, arm: null, lcp: 0, k: 0 })];
  let incumbent = { branch: [0], cost: Infinity, k: 0 };
  for (const { k: at, tree } of steps) {
    const added = tree.node;
    if (added) {
      nodes[added.parent].children.push(added.node);
      nodes[added.node] = node(added.node, added.parent, nodes[added.parent].depth + 1, { obj: added.obj, arm: added.arm, lcp: added.lcp, k: at });
    }
    for (const number of tree.branch) {
      nodes[number].visits += 1;
      nodes[number].cost += tree.cost;
    }
    if (tree.incumbent < incumbent.cost) incumbent = { branch: tree.branch, cost: tree.incumbent, k: at };
  }
  for (const n of nodes) n.mean = n.visits ? n.cost / n.visits : Infinity;
  const last = steps.at(-1).tree;
  return { nodes, steps, branch: last.branch, choices: last.choices ?? [], incumbent };
}

/** @type {(a: TreeNode, b: TreeNode) => number} */
const first = (a, b) => b.visits - a.visits || a.mean - b.mean || a.number - b.number;
/** @type {(tree: Searched, node: TreeNode) => TreeNode[]} */
const childrenOf = (tree, node) => node.children.map((c) => tree.nodes[c]).sort(first);

// The boxes: what lies on the two ways is always drawn, then what was visited most; the rest is folded by parent.
/** @param {Searched} tree */
function boxesOf(tree) {
  const shown = new Set([0, ...tree.branch, ...tree.incumbent.branch]);
  const below = (node) => {
    const children = childrenOf(tree, node);
    const hidden = children.filter((c) => !shown.has(c.number));
    const drawn = children.filter((c) => shown.has(c.number)).map((c) => ({ node: c, below: below(c), visits: c.visits }));
    if (hidden.length) drawn.push({ fold: hidden, below: [], visits: hidden.reduce((n, c) => n + c.visits, 0) });
    return drawn;
  };
  const leaves = (list) => list.reduce((n, one) => n + (one.below.length ? leaves(one.below) : 1), 0);
  let free = Math.floor(WIDTH / NARROWEST) - leaves(below(tree.nodes[0]));
  for (;;) {
    const near = [...shown].flatMap((n) => {
      const hidden = tree.nodes[n].children.filter((c) => !shown.has(c));
      return free > 0 || hidden.length === 1 ? hidden.map((c) => tree.nodes[c]) : [];
    }).sort(first);
    if (!near.length) break;
    shown.add(near[0].number);
    if (tree.nodes[near[0].parent].children.some((c) => !shown.has(c))) free -= 1;
  }
  const top = below(tree.nodes[0]);
  const n = Math.max(leaves(top), 1);
  const least = Math.min(NARROWEST, WIDTH / n);
  const visitsOf = (list) => list.reduce((sum, one) => sum + (one.below.length ? visitsOf(one.below) : one.visits), 0);
  const spare = (WIDTH - least * n) / Math.max(visitsOf(top), 1);
  const boxes = [];
  const place = (list, x, depth) => {
    for (const one of list) {
      const own = one.below.length ? one.below : [one];
      const width = least * leaves(own) + spare * visitsOf(own);
      boxes.push({ ...one, x, width, depth });
      place(one.below, x, depth + 1);
      x += width;
    }
  };
  place(top, 0, 1);
  return boxes;
}

/** @type {(tree: Searched, nodes: TreeNode[]) => number} */
const count = (tree, nodes) => nodes.reduce((n, one) => n + 1 + count(tree, childrenOf(tree, one)), 0);
const px = (/** @type {number} */ x) => Math.round(x).toLocaleString("en");

/** @param {{ tree: Searched, moment: Moment }} props */
export function Tree({ tree, moment }) {
  const objects = useStore((s) => s.frame.objects);
  const boxes = useMemo(() => boxesOf(tree), [tree]);
  /** @param {number | undefined} id */
  const of = (id) => objects.find((o) => o.id === id) ?? { label: "object", color: "#888" };
  const means = tree.nodes.slice(1).map((n) => n.mean);
  const [low, high] = [Math.min(...means), Math.max(...means)];
  const color = (/** @type {number} */ mean) => {
    const t = high > low ? (mean - low) / (high - low) : 0;
    return `rgb(${CHEAP.map((c, i) => Math.round(c + (DEAR[i] - c) * t)).join()})`;
  };
  const layers = Math.max(1, ...boxes.map((b) => b.depth));
  const [x, series] = useMemo(() => [tree.steps.map((s) => s.k), [
    { name: "incumbent", values: tree.steps.map((s) => s.tree.incumbent / 1000), color: palette.stages.best, kind: "steps" },
    { name: "this scene", values: tree.steps.map((s) => s.tree.cost / 1000), color: palette.stages.current, kind: "points" },
  ]], [tree]);
  const named = (/** @type {TreeNode} */ n) => `${of(n.obj).label} from hypothesis ${n.arm + 1}`;
  /** @param {TreeNode} n */
  const numbers = (n) => `${n.visits} visit${n.visits === 1 ? "" : "s"}, ${px(n.mean)} px per visit, LCP ${number(n.lcp)}`;
  const listed = tree.nodes.slice(1).filter((n) => tree.branch.includes(n.number) || tree.incumbent.branch.includes(n.number) || n.children.length || n.visits > 1)
    .sort((a, b) => a.depth - b.depth || first(a, b)).slice(0, 40);
  return html`
    <p class="summary">${counted(tree.nodes.length - 1, "node")}. The best scene leaves ${px(tree.incumbent.cost)} px unexplained,${" "}
      <button type="button" class="link" title="go there" onClick=${() => seek(tree.incumbent.k)}>iteration ${tree.incumbent.k}</button>.</p>
    <svg class="tree" viewBox=${`${-STRIP} 0 ${WIDTH + STRIP} ${layers * (LAYER + GAP)}`}>
      ${[...Array(layers).keys()].map((d) => {
        const one = tree.nodes.find((n) => n?.depth === d + 1);
        return one && html`<rect x=${-STRIP} y=${d * (LAYER + GAP)} width=${STRIP - 2} height=${LAYER} fill=${of(one.obj).color}><title>${of(one.obj).label}</title></rect>`;
      })}
      ${boxes.map((b) => {
        const y = (b.depth - 1) * (LAYER + GAP);
        const node = b.node ?? [...b.fold].sort((m, n) => m.mean - n.mean)[0];
        const way = b.node && (tree.incumbent.branch.includes(b.node.number) ? "incumbent" : "");
        const caption = b.fold ? `+${count(tree, b.fold)}` : `h${node.arm + 1}${b.width >= WITH_VISITS ? ` · ${node.visits}×` : ""}`;
        return html`<g class="node" onClick=${() => seek(node.k)}>
          <rect class=${b.fold ? "fold" : ""} x=${b.x} y=${y} width=${Math.max(b.width - 1, 1)} height=${LAYER} fill=${color(node.mean)} />
          ${way && html`<rect class="way" x=${b.x + 1} y=${y + 1} width=${Math.max(b.width - 3, 1)} height=${LAYER - 2} stroke=${INCUMBENT} />`}
          ${b.node && tree.branch.includes(b.node.number) && html`<rect class="way" x=${b.x + 3} y=${y + 3} width=${Math.max(b.width - 7, 1)} height=${LAYER - 6} stroke="#fff" />`}
          <text x=${b.x + 4} y=${y + 16}>${caption}</text>
          <title>${b.fold ? `${count(tree, b.fold)} nodes more; the cheapest of them: ` : ""}${named(node)}: ${numbers(node)}; added in iteration ${node.k}</title>
        </g>`;
      })}
    </svg>
    <p class="key"><span><${Swatch} color=${`rgb(${CHEAP})`} />cheap</span><span><${Swatch} color=${`rgb(${DEAR})`} />dear per visit</span>
      <span><${Swatch} color="#fff" />this branch</span><span><${Swatch} color=${INCUMBENT} hollow />way to the best scene</span>
      <span>h3 · 7× = hypothesis 3, 7 visits</span></p>
    ${tree.choices.length > 0 && html`<h3 title="a node is taken where its cost per visit minus its bonus for few visits is lowest; untried ones come first">Why this branch</h3>
      ${tree.choices.map((choice, i) => html`<p><b>${of(tree.nodes[tree.branch[i + 1]]?.obj).label}</b> ${choice}</p>`)}`}
    <h3>Cost of the scenes</h3>
    <${Chart} series=${series} x=${x} yLabel="unexplained" units="1000 px" digits=${2} cursor=${moment.k || null} onSeek=${seek} />
    <${Table} rows=${listed} keyOf=${(n) => n.number} onRow=${(n) => seek(n.k)} current=${(n) => n.number === tree.branch.at(-1)} columns=${columnsOf(listed, [
      { title: "node", left: true, of: (n) => html`<span style=${{ paddingLeft: `${0.8 * (n.depth - 1)}rem` }}><${Swatch} color=${of(n.obj).color} />${of(n.obj).label} ${n.arm + 1}</span>` },
      { title: "visits", of: (n) => n.visits },
      { title: "px/visit", hint: "mean cost of the complete scenes below it: pixels that are not explained", of: (n) => px(n.mean) },
      { title: "LCP", hint: "share of the model's points that the segment explains: what was tried first", of: (n) => number(n.lcp) },
    ])} />`;
}
