"use strict";
const root = document.documentElement;
const charts = [];

function color(name) { return getComputedStyle(root).getPropertyValue(name).trim(); }

function themed(place) {
  const axis = { gridcolor: color("--grid"), linecolor: color("--line"), tickcolor: color("--line") };
  const out = { "font.color": color("--dim"), "font.family": getComputedStyle(document.body).fontFamily, "font.size": 12 };
  const axes = Object.keys(place.layout ?? {}).filter((name) => /^[xy]axis\d*$/.test(name));
  for (const name of axes) for (const key in axis) out[name + "." + key] = axis[key];
  return out;
}

async function draw(place) {
  const figure = JSON.parse(document.getElementById(place.dataset.figure).textContent);
  figure.layout.autosize = true;
  place.style.height = figure.layout.height + "px";
  await Plotly.newPlot(place, figure.data, figure.layout, { displayModeBar: false, responsive: true });
  charts.push(place);
  await Plotly.relayout(place, themed(place));
}

function setTheme(theme) {
  root.dataset.theme = theme;
  for (const place of charts) Plotly.relayout(place, themed(place));
}

const prefersDark = matchMedia("(prefers-color-scheme: dark)");
let chosen = prefersDark.matches ? "dark" : "light";
root.dataset.theme = chosen;
prefersDark.addEventListener("change", (e) => setTheme((chosen = e.matches ? "dark" : "light")));
document.getElementById("theme").addEventListener("click", () => setTheme((chosen = chosen === "dark" ? "light" : "dark")));

// Paper is narrower than the screen, and charts do not follow by themselves.
const PAPER = { half: 300, whole: 650 };
addEventListener("beforeprint", () => {
  setTheme("light");
  for (const place of charts) Plotly.relayout(place, { width: place.closest(".two > :not(.wide), .failure") ? PAPER.half : PAPER.whole });
});
addEventListener("afterprint", () => {
  setTheme(chosen);
  for (const place of charts) Plotly.relayout(place, { width: null, autosize: true });
});

// Tables: a click on a head sorts by that column, another one the other way round.
for (const head of document.querySelectorAll("th.sort")) {
  head.tabIndex = 0;
  const sort = () => {
    const table = head.closest("table"), body = table.tBodies[0], k = head.cellIndex;
    const up = head.getAttribute("aria-sort") === "descending";
    const value = (row) => row.cells[k].dataset.value ?? row.cells[k].textContent.trim();
    const text = head.classList.contains("text");
    const rows = [...body.rows].sort((a, b) => {
      const [x, y] = [value(a), value(b)];
      if (text) return x.localeCompare(y) * (up ? -1 : 1) * -1;
      const [p, q] = [parseFloat(x), parseFloat(y)];
      if (isNaN(p) || isNaN(q)) return isNaN(p) - isNaN(q);
      return up ? p - q : q - p;
    });
    for (const other of table.tHead.querySelectorAll("th")) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    body.append(...rows);
  };
  head.addEventListener("click", sort);
  head.addEventListener("keydown", (e) => { if (e.key === "Enter") sort(); });
}

// The gallery: filters and order.
const cards = [...document.querySelectorAll(".failure")];
const FILTERS = {
  group: (card, value) => card.dataset.group === value,
  cause: (card, value) => card.dataset.causes.split("|").includes(value),
  object: (card, value) => card.dataset.object === value,
};
const field = (id) => document.getElementById(id);
function arrange() {
  const wanted = Object.keys(FILTERS).map((name) => [name, field(name)?.value ?? ""]), by = field("order").value;
  let n = 0;
  for (const card of cards) {
    card.hidden = wanted.some(([name, value]) => value && !FILTERS[name](card, value));
    n += !card.hidden;
  }
  const number = (card) => parseFloat(card.dataset[by]);
  const sorted = [...cards].sort((a, b) => by === "frame" ? a.dataset.place - b.dataset.place
    : by === "error" ? number(b) - number(a) : by === "liar" ? number(b) - number(a) : number(a) - number(b));
  document.querySelector(".gallery").append(...sorted);
  field("shown").textContent = n === cards.length ? "" : n + " of " + cards.length + " shown";
}
if (cards.length) for (const id of [...Object.keys(FILTERS), "order"]) field(id)?.addEventListener("change", arrange);

// A link to a card that a filter hides shows all of them.
document.addEventListener("click", (e) => {
  const card = document.getElementById(e.target.closest?.("a[href^='#card-']")?.hash.slice(1));
  if (!card?.hidden) return;
  for (const name in FILTERS) if (field(name)) field(name).value = "";
  arrange();
});

(async () => {
  for (const place of document.querySelectorAll(".chart")) {
    await draw(place);
    await new Promise((next) => setTimeout(next));
  }
  root.dataset.ready = "yes";
})();
