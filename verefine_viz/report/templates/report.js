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
  for (const place of charts) Plotly.relayout(place, { width: place.closest(".two > :not(.wide), .entry") ? PAPER.half : PAPER.whole });
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

(async () => {
  for (const place of document.querySelectorAll(".chart")) {
    await draw(place);
    await new Promise((next) => setTimeout(next));
  }
  root.dataset.ready = "yes";
})();
