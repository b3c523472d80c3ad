// Faults of the layout that can be measured: called in the page, gives lists of words.
() => {
  const all = (selector) => [...document.querySelectorAll(selector)].filter((e) => e.offsetParent);
  const named = (e) => `${e.className || e.tagName} ${e.innerText.slice(0, 40)}`;
  const sideways = (e) => e.scrollWidth > e.clientWidth + 1;
  const bars = [".page", ".verdict", ".pane > header", ".tools", ".controls", ".controls .group", ".status", ".tabs",
    ".acts", ".posed"];
  const single = [...bars.slice(1), ".pane > header h2", ".presets", ".button", ".tab", ".map-name", ".tab-content h3",
    ".table th"];

  const overlaps = all(bars.join()).flatMap((bar) => {
    const boxes = [...bar.children].map((e) => [e, e.getBoundingClientRect()])
      .filter(([e, r]) => e.checkVisibility({ visibilityProperty: true }) && r.width && r.height
        && !e.matches(".measure, .splitter, .toasts, .veil, .popup"));
    const both = ([, a], [, b]) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
      && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
    return boxes.flatMap((one, i) => boxes.slice(i + 1).filter((other) => both(one, other))
      .map((other) => `${named(one[0])} and ${named(other[0])} in ${bar.className}`));
  });

  const context = document.createElement("canvas").getContext("2d");
  const choices = all("select").filter((e) => {
    const css = getComputedStyle(e);
    context.font = css.font;
    const room = e.clientWidth - parseFloat(css.paddingLeft) - parseFloat(css.paddingRight); // its arrow is there
    return e.selectedOptions[0] && context.measureText(e.selectedOptions[0].text).width > room;
  });

  const parts = [...document.querySelectorAll(".page > :is(.pane, .timeline, .inspector, .verdict, .film, .status)")]
    .filter((e) => e.checkVisibility({ visibilityProperty: true })).map((e) => e.getBoundingClientRect());
  return {
    overlaps,
    cut: all(single.join()).filter((e) => sideways(e) && !e.closest(".measure, .two, .named")).map(named),
    "cut choices": choices.map((e) => `${e.title || e.className}: ${e.selectedOptions[0].text}`),
    scrolls: [document.documentElement, ...all(".tab-content, .objects .scroll, .timeline, .inspector")]
      .filter(sideways).map(named),
    "no title": all("button").filter((b) => !b.title).map(named),
    outside: all(".popup").filter((e) => e.getBoundingClientRect().right > innerWidth).map(named),
    "tabs in rows": new Set(all(".tabs > .tab").map((e) => e.offsetTop)).size > 1 ? ["tabs"] : [],
    empty: parts.reduce((area, r) => area + r.width * r.height, 0) < 0.97 * innerWidth * innerHeight ? ["page"] : [],
  };
}
