// What the style sheets go by: attributes that our blocks ask for, on elements that are the library's. Selectors with
// :has() would say the same, but for each of them the browser looks through the page at every change of any block.
{
  const root = document.documentElement;
  const WINDOWS = {  // By class of a block inside of it.
    "image-pane": "image", "scene-pane": "3D", strip: "maps", line: "timeline", "gallery-pane": "gallery", curves: "corner",
    objects: "corner",
  };
  const BLOCKS = Object.keys(WINDOWS).map(name => `.vz.${name},.vz>.${name}`).join();
  let empty = {};  // Why a tab has nothing to show, by its name.

  const all = (added, selector) => added.flatMap(e => [...(e.matches(selector) ? [e] : []), ...e.querySelectorAll(selector)]);
  const mark = added => {
    for (const label of all(added, "label[for]")) {
      const row = label.closest(".mantine-Flex-root")?.parentElement;
      if (row) row.dataset.row = label.htmlFor;
    }
    for (const block of all(added, BLOCKS)) {
      const name = Object.keys(WINDOWS).find(name => block.classList.contains(name));
      const inside = block.closest("[data-floating-window]");
      if (inside) inside.dataset.holds = WINDOWS[name];
    }
    for (const {dataset} of all(added, ".vz .presets")) {
      root.dataset.preset = dataset.preset;
      if (dataset.enlarged) root.dataset.enlarged = dataset.enlarged;
      else delete root.dataset.enlarged;
    }
    for (const maps of all(added, ".vz .maps")) root.toggleAttribute("data-coloured", maps.classList.contains("coloured"));
    const last = all(added, ".vz [data-empty]").pop();
    if (last) empty = JSON.parse(last.dataset.empty);
    for (const tab of last ? document.querySelectorAll("[data-dock-tab]") : all(added, "[data-dock-tab]")) {
      const name = tab.textContent;
      tab.toggleAttribute("data-empty", name in empty);
      tab.title = empty[name] ?? name;
    }
  };
  new MutationObserver(records => {
    const added = records.flatMap(record => [...record.addedNodes]).filter(e => e.nodeType === 1 && e.isConnected);
    if (added.length) mark(added);
  }).observe(document, {subtree: true, childList: true});
}
