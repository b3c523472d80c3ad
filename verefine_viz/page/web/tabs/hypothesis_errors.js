// What became of the hypotheses: error and score of each after every call of the refiner, what led the answer away, and how
// far from the truth each began and went.
import { html } from "htm/preact";
import { setView } from "../store.js";
import { rowsOf, sourceOf } from "../moment.js";
import { seek } from "../cursor.js";
import { stageColor } from "../palette.js";
import { Bar, number } from "../ui.js";

/** @import { FindingShown, IterationRow, ScoredStage } from "../messages.d.ts" */
/** @import { Moment } from "../moment.js" */

const MOST = 12; // hypotheses that are drawn: the nearest at first, with that of the answer
const FEW = 4; // that have more room each
const [W, H] = [200, 30];

// What the refiner made, else what was accepted.
/** @type {(row: IterationRow) => Partial<ScoredStage>} */
const afterCall = (row) => row.stages.find((s) => s.name === "refined") ?? row.stages.find((s) => s.name === row.accepted) ?? {};

/**
 * Hypotheses, the nearest at first.
 * @param {Moment} moment
 */
function hypothesesOf({ run, obj, starts, arms, best }) {
  const all = starts.map((start, j) => {
    const calls = rowsOf(run, obj).filter((row) => row.arm === j).map((row) => ({ k: row.k, ...afterCall(row) }));
    return { j, start: start.err, first: start.score, calls, now: arms[j]?.err ?? start.err, best: best?.arm === j ? best : null, score: arms[j]?.score };
  });
  const sorted = all.sort((a, b) => (a.start ?? Infinity) - (b.start ?? Infinity) || a.j - b.j);
  const answers = sorted.slice(MOST).find((one) => one.best);
  return answers ? [...sorted.slice(0, MOST - 1), answers] : sorted.slice(0, MOST);
}

/**
 * A line a hypothesis, all to one scale: the longer the more it was played, the lower the nearer to the truth.
 * @param {{ moment: Moment, limit: number }} props
 */
export function Calls({ moment, limit }) {
  const list = hypothesesOf(moment);
  const most = Math.max(1, ...list.map((one) => one.calls.length));
  const top = Math.max(1.5 * limit, ...list.flatMap((one) => [one.start ?? 0, ...one.calls.map((c) => c.err ?? 0)]));
  const x = (/** @type {number} */ n) => 7 + (n / most) * (W - 14);
  const y = (/** @type {number} */ share) => H - 4 - share * (H - 9);
  const spent = moment.arms.length - list.length;
  const scores = list.some((one) => one.calls.some((c) => c.score != null));
  const rest = spent > 0 ? ` · ${spent} more hypotheses began further off` : "";
  return html`<h3>Error call by call${list.length > 1 ? ", nearest start first" : ""}</h3>
    <div class=${`calls ${list.length > FEW ? "" : "few"}`}>
      <span class="dim">#</span><span class="dim ends"><span>start</span><span>${most} call${most === 1 ? "" : "s"} of the refiner</span></span><span class="dim">calls</span><span class="dim" title="error of its latest pose">mm now</span>
      ${list.map((one) => html`<${Lane} key=${one.j} one=${one} moment=${moment} limit=${limit} x=${x} y=${y} top=${top} />`)}
    </div>
    <p class="key"><span><svg viewBox="0 0 24 10"><path d="M0 7h24" class="error" /></svg>error, 0 to ${number(top, 0)} mm</span>
      ${scores && html`<span><svg viewBox="0 0 24 10"><path d="M0 5h24" class="score" /></svg>score, 0 to 1</span>`}
      <span class="good">band: right, below ${number(limit, 1)} mm</span>
      ${moment.best?.k > 0 && moment.best.err != null && html`<span><svg viewBox="0 0 10 10"><circle cx="5" cy="5" r="3.6" class="best" /></svg>${moment.isAnswer ? "answer" : "best so far"}, ${number(moment.best.err, 1)} mm</span>`}${rest}</p>`;
}

// A round mark whatever the picture is stretched to: a line of no length with a round end.
const dot = (/** @type {number} */ x, /** @type {number} */ y) => `M${x} ${y}h0.001`;

function Lane({ one, moment, limit, x, y, top }) {
  const { j, start, calls, now, best } = one;
  const line = (values) => values.map((v, i) => [i, v]).filter(([, v]) => v != null).map(([i, v]) => `${x(i)},${y(v)}`).join(" ");
  const focus = () => setView({ obj: moment.obj, arm: moment.arm === j ? null : j });
  const title = `hypothesis ${j + 1}${sourceOf(moment, j) ? `, ${sourceOf(moment, j)}` : ""}: ${number(start, 1)} mm at its start, ${number(now, 1)} mm now, ${calls.length} calls, score ${number(one.score, 3)}${best ? "; the answer came from it" : ""}`;
  const high = (/** @type {number} */ err) => y(err / top);
  return html`<button type="button" class=${`number ${j === moment.arm ? "current" : ""}`} title=${title} onClick=${focus}>${j + 1}${best ? html`<b class="answers">✓</b>` : ""}</button>
    <svg viewBox=${`0 0 ${W} ${H}`} preserveAspectRatio="none"><title>${title}</title>
      <rect class="right" x="0" width=${W} y=${high(limit)} height=${H - high(limit)} />
      <polyline class="score" points=${line([one.first, ...calls.map((c) => c.score)])} />
      <polyline points=${line([start, ...calls.map((c) => c.err)].map((err) => (err == null ? null : err / top)))} />
      ${start != null && html`<path class="start" d=${dot(x(0), high(start))} /><path class="start hole" d=${dot(x(0), high(start))} />`}
      ${calls.map((c, i) => c.err != null && html`${c.k === best?.k && html`<path class="best" d=${dot(x(i + 1), high(c.err))} />`}<path
        class=${c.err < limit ? "good" : "bad"} d=${dot(x(i + 1), high(c.err))} onClick=${() => seek(c.k)}>
        <title>iteration ${c.k}: ${number(c.err, 1)} mm, score ${number(c.score, 3)}${c.k === best?.k ? "; the answer" : ""}</title></path>`)}
    </svg>
    <b class=${calls.length ? "" : "bad"}>${calls.length}</b><span class=${now == null ? "" : now < limit ? "good" : "bad"}>${number(now, 1)}</span>`;
}

/**
 * What added to the error on the way from the nearest pose that the answer came from, as its cause measured it.
 * @param {{ moment: Moment }} props
 */
export function LedAway({ moment }) {
  const { verdict, object } = moment;
  const numbers = verdict?.findings.find((/** @type {FindingShown} */ f) => f.numbers.added_by_refiner != null)?.numbers;
  const beside = verdict?.findings.find((/** @type {FindingShown} */ f) => f.numbers.error_from_ground_truth != null)?.numbers;
  const mm = (/** @type {number} */ share) => share * object.diameter_mm;
  const added = numbers ? /** @type {[string, number, string][]} */ ([
    ["simulation", mm(numbers.added_by_simulation), "simulated"], ["refiner", mm(numbers.added_by_refiner), "refined"],
  ]) : [];
  const top = numbers && Math.max(mm(numbers.error_before), mm(numbers.error), ...added.map(([, more]) => more));
  return html`${numbers && html`<h3>What led the answer away</h3>
    <div class="led-away"><span>nearest before</span><${Bar} share=${mm(numbers.error_before) / top} color="var(--dim)" /><b>${number(mm(numbers.error_before), 1)} mm</b>
      ${added.map(([name, more, stage]) => html`<span>${name} added</span><${Bar} share=${more / top} color=${stageColor(stage)} /><b>+${number(more, 1)}</b>`)}
      <span>answer</span><${Bar} share=${mm(numbers.error) / top} color=${stageColor("best")} /><b>${number(mm(numbers.error), 1)} mm</b></div>`}
    ${beside && html`<p>Started at the truth, a run ends <b>${number(mm(beside.error_from_ground_truth), 1)} mm</b> from it.</p>`}`;
}

const [SIDE, TALL] = [300, 150];

/**
 * Initial poses by how far they are turned and shifted, and where they went from there, call by call; where a learned
 * refiner's range is known, whether they are in it.
 * @param {{ moment: Moment }} props
 */
export function Starts({ moment }) {
  const trained = moment.verdict?.trained ?? null;
  const starts = trained ? trained.starts.map(([deg, mm]) => ({ deg, mm })) : moment.starts.map(({ deg, mm }) => ({ deg, mm }));
  const known = starts.map((one, j) => ({ ...one, j })).filter((one) => one.deg != null && one.mm != null);
  if (!known.length) return null;
  // A range is about shifts of the object's middle, errors of iterations about those of its origin.
  const ways = trained ? [] : known.map(({ j, deg, mm }) => ({ j, way: [{ deg, mm, err: moment.starts[j].err },
    ...rowsOf(moment.run, moment.obj).filter((row) => row.arm === j && row.k <= moment.k).map(afterCall)].filter((p) => p.deg != null && p.mm != null) }))
    .filter(({ way }) => way.length > 1);
  const all = [...known, ...ways.flatMap(({ way }) => way)];
  const [most_deg, most_mm] = [Math.max(30, trained?.deg ?? 0, ...all.map((o) => o.deg)), Math.max(10, trained?.mm ?? 0, ...all.map((o) => o.mm))].map((v) => 1.1 * v);
  const x = (/** @type {number} */ deg) => (deg / most_deg) * SIDE;
  const y = (/** @type {number} */ mm) => TALL - (mm / most_mm) * TALL;
  // Points that lie on each other have one label.
  /** @type {typeof known[]} */
  const near = [];
  for (const one of known) {
    const there = near.find(([first]) => Math.abs(x(first.deg) - x(one.deg)) < 16 && Math.abs(y(first.mm) - y(one.mm)) < 12);
    if (there) there.push(one);
    else near.push([one]);
  }
  const within = trained && known.filter((o) => o.deg <= trained.deg && o.mm <= trained.mm).length;
  return html`<h3>Initial poses${ways.length ? ", and where they went" : ", from the truth"}</h3>
    <figure class="starts"><span class="up dim">shift, ${number(most_mm, 0)} mm</span>
      <svg viewBox=${`0 0 ${SIDE} ${TALL}`}>
        ${trained && html`<rect class="right" x="0" y=${y(trained.mm)} width=${x(trained.deg)} height=${TALL - y(trained.mm)} />`}
        <path class="truth" d=${`M0 ${TALL}v-14M0 ${TALL}h14`} /><text x="5" y=${TALL - 6}>truth</text>
        ${ways.map(({ j, way }) => html`<${Way} key=${`way ${j}`} points=${way.map((p) => [x(p.deg), y(p.mm)])} isNearer=${way.at(-1).err < way[0].err} />`)}
        ${known.map((o) => html`<g key=${o.j}><circle class=${!trained ? "" : o.deg > trained.deg || o.mm > trained.mm ? "bad" : "good"} cx=${x(o.deg)} cy=${y(o.mm)} r="5" /><title>hypothesis ${o.j + 1}: ${number(o.deg, 1)}°, ${number(o.mm, 1)} mm</title></g>`)}
        ${near.map((all) => html`<text key=${all[0].j} class="numbers" x=${x(all[0].deg)} y=${y(all[0].mm) - 8}>${all.length > 6 ? `${all.length} poses` : all.map((o) => o.j + 1).join(" ")}</text>`)}
      </svg>
      <span class="across dim"><span>0</span><span>turn</span><span>${number(most_deg, 0)}°</span></span></figure>
    ${ways.length > 0 && html`<p class="key"><span>→ call by call of the refiner</span><span class="good">ends nearer</span><span class="bad">ends further off</span></p>`}
    ${trained ? html`<p class="dim"><span class="good">Band: what the refiner was trained on</span>, up to ${number(trained.deg, 0)}° and ${number(trained.mm, 0)} mm; <b class=${within ? "good" : "bad"}>${within} of ${known.length}</b> within.</p>` : ""}`;
}

/**
 * From a start over what each call made of it, with a head at its end.
 * @param {{ points: number[][], isNearer: boolean }} props
 */
function Way({ points, isNearer }) {
  const end = points.at(-1);
  const from = points.findLast(([x, y]) => Math.hypot(x - end[0], y - end[1]) > 3) ?? points[0];
  const angle = (180 / Math.PI) * Math.atan2(end[1] - from[1], end[0] - from[0]);
  return html`<g class=${`way ${isNearer ? "good" : "bad"}`}><polyline points=${points.map((p) => p.join()).join(" ")} />
    <path d="M0 0l-9-4v8z" transform=${`translate(${end[0]} ${end[1]}) rotate(${angle})`} /></g>`;
}
