// A gallery of answers: search, filters and order, for the page and for the report. On the page moreover: pictures of the
// tiles in sight, keys, selection, tags and saved filters; what others must know is sent as a "command".
{
  const all = selector => [...document.querySelectorAll(selector)];
  const make = (name, text, more = {}) => Object.assign(document.createElement(name), {textContent: text, ...more});
  const BROWSER = Math.random().toString(36).slice(2);  // Tells our own choices, when they come back, from others'.
  let grid = null, bar = null, onPage = false, entries = [], shown = [], state = null;
  let current = null, from = null;  // The tile that keys move from, and the one at which a range begins.
  const chosen = new Set();
  const field = selector => bar.querySelector(selector);
  const filters = () => [...bar.querySelectorAll("[data-by]")];
  const tell = (command, fields) => document.dispatchEvent(new CustomEvent("command", {detail: {command, ...fields}}));

  // What is shown

  const arrangement = () => ({
    order: field(".order").value,
    only: filters().filter(select => select.value).map(select => [select.dataset.by, select.value]),
    search: field(".search").value.trim(),
  });
  const passes = (entry, only, words) =>
    only.every(([by, value]) => (by === "tag" ? entry.tags : entry.values[by])?.includes(value)) &&
    words.every(word => entry.words.includes(word) || entry.tags.some(tag => tag.toLowerCase().includes(word)));
  const arrange = () => {
    const {order, only, search} = arrangement(), words = search.toLowerCase().split(/\s+/).filter(Boolean);
    const sorted = [...entries].sort((a, b) => a.places[order] - b.places[order]);
    if (sorted.some((entry, k) => entries[k] !== entry)) grid.append(...sorted.map(entry => entry.element));
    entries = sorted;
    shown = entries.filter(entry => passes(entry, only, words));
    const visible = new Set(shown);
    for (const entry of entries) if (entry.element.hidden === visible.has(entry)) entry.element.hidden = !visible.has(entry);
    for (const entry of chosen) if (!visible.has(entry)) chosen.delete(entry);
    for (const select of filters()) select.classList.toggle("active", select.value !== "");
    const n = entries.length;
    field(".shown").textContent = shown.length === n ? `${n} answer${n === 1 ? "" : "s"}` : `${shown.length} of ${n}`;
    grid.querySelector(".none-shown")?.remove();
    if (!shown.length) grid.append(make("p", "No match: choose other filters.", {className: "none-shown"}));
    if (!visible.has(current)) moveTo(shown[0] ?? null, false);
    showChosen();
  };
  const set = ({order, only, search}) => {
    field(".order").value = order;
    for (const select of filters()) {
      const value = Object.fromEntries(only)[select.dataset.by] ?? "";
      select.value = value;
      if (select.value !== value) select.value = "";  // None has it any more.
    }
    field(".search").value = search;
    arrange();
  };
  let telling = 0;
  const rearranged = () => {
    arrange();
    grid.scrollTop = 0;
    clearTimeout(telling);
    if (onPage) telling = setTimeout(() => tell("ArrangeGallery", {...arrangement(), browser: BROWSER}), 150);
  };

  // Tags and saved filters, as the program knows them

  const options = (select, first, names) => {
    const value = select.value;
    select.replaceChildren(make("option", first, {value: ""}), ...names.map(name => make("option", name, {value: name})));
    select.value = names.includes(value) ? value : "";
  };
  const showTags = () => {
    const tags = [...new Set(entries.flatMap(entry => entry.tags))].sort(), select = field("[data-by=tag]");
    options(select, "any tag", tags);
    select.hidden = !tags.length;
    field("datalist")?.replaceChildren(...tags.map(tag => make("option", "", {value: tag})));
  };
  const tagged = (entry, tags) => {
    if (entry.tags.join("\n") === tags.join("\n") && entry.drawn) return false;
    entry.tags = tags;
    entry.drawn = true;
    entry.element.querySelector(".tags").replaceChildren(...tags.map(tag => make("span", tag)));
    return true;
  };
  const showState = () => {
    const text = document.querySelector(".gallery-state")?.dataset.state;
    if (!text || text === state?.text) return;
    const before = state;
    state = {...JSON.parse(text), text};
    let changed = false;
    for (const entry of entries) {
      changed = tagged(entry, state.tags[entry.key] ?? []) || changed;
      entry.element.classList.toggle("open", entry.key === String(state.open));
    }
    if (changed) showTags();
    options(field(".saved"), "saved filters", Object.keys(state.filters).sort());
    field(".saved").hidden = !Object.keys(state.filters).length;
    field(".drop").hidden = !field(".saved").value;
    const wanted = s => JSON.stringify([s.order, Object.entries(s.only), s.search, s.by]);
    if (!before || (wanted(before) !== wanted(state) && state.by !== BROWSER)) {
      set({...state, only: Object.entries(state.only)});
    } else if (changed) arrange();
    const open = entries.find(entry => entry.key === String(state.open));
    if (open && before && before.open !== state.open && shown.includes(open)) moveTo(open);
  };

  // Selection

  const moveTo = (entry, look = true) => {
    current?.element.classList.remove("current");
    current = entry;
    if (!entry || !onPage) return;
    entry.element.classList.add("current");
    if (look) entry.element.scrollIntoView({block: "nearest"});
  };
  const toggle = entry => {
    if (!chosen.delete(entry)) chosen.add(entry);
    from = entry;
    showChosen();
  };
  const chooseTo = entry => {
    const [a, b] = [shown.indexOf(from ?? current), shown.indexOf(entry)].sort((x, y) => x - y);
    for (const one of shown.slice(Math.max(a, 0), b + 1)) chosen.add(one);
    showChosen();
  };
  const showChosen = () => {
    if (!onPage) return;
    for (const entry of entries) entry.element.classList.toggle("chosen", chosen.has(entry));
    field(".chosen").hidden = !chosen.size;
    field(".chosen b").textContent = `${chosen.size} selected`;
    const own = [...new Set([...chosen].flatMap(entry => entry.tags))].sort();
    field(".own-tags").replaceChildren(...own.map(tag => make("button", `${tag} ×`, {title: "Take this tag away"})));
    for (const [k, button] of [...field(".own-tags").children].entries()) button.dataset.tag = own[k];
  };
  const tag = (name, on) => tell("TagAnswers", {answers: [...chosen].map(entry => +entry.key), tag: name, on});
  const open = entry => {
    if (entry?.element.dataset.open) tell(...(({command, ...fields}) => [command, fields])(JSON.parse(entry.element.dataset.open)));
  };

  // Pictures of the tiles in sight, some at once; the program makes each when it is asked for, and may be busy

  const MOST_AT_ONCE = 4, AGAIN_MS = 1000;
  let asking = 0;
  const inSight = new Set();
  const fetchNext = async () => {
    if (asking >= MOST_AT_ONCE) return;
    const entry = [...inSight].find(entry => entry.picture === undefined);
    if (!entry) return;
    entry.picture = null;
    asking++;
    fetchNext();
    const answer = await fetch(`/picture/${entry.key}`).catch(() => ({status: 0}));
    const place = entry.element.querySelector(".pic");
    if (answer.status === 200) {
      place.replaceChildren(make("img", "", {alt: "", src: URL.createObjectURL(await answer.blob())}));
    } else if (answer.status === 204) {
      place.replaceChildren(make("i", "no picture"));
    } else {
      setTimeout(() => { entry.picture = undefined; fetchNext(); }, AGAIN_MS);
    }
    asking--;
    fetchNext();
  };
  const watchAll = () => {
    const of = new Map(entries.map(entry => [entry.element, entry]));
    const watch = new IntersectionObserver(changes => {
      for (const {target, isIntersecting} of changes) {
        if (isIntersecting) inSight.add(of.get(target)); else inSight.delete(of.get(target));
      }
      fetchNext();
    }, {root: grid, rootMargin: "300px"});
    for (const element of of.keys()) watch.observe(element);
  };

  // A gallery that was just written into the document

  // Where a folder is watched it is written again with each change: how far it is scrolled, the box that is being typed
  // in, the selection and the pictures of tiles that are there again stay.
  let scrolled = 0, left = null;
  addEventListener("scroll", event => { if (event.target === grid && grid.isConnected) scrolled = grid.scrollTop; }, true);
  addEventListener("focusout", event => {
    const box = event.target;
    if (box.matches?.(".gallery-bar input:not([type=range])")) left = {box, value: box.value, at: performance.now()};
  });
  const identity = entry => `${entry.element.dataset.open} ${entry.element.title}`;
  const takeOver = before => {
    const known = new Map(before.map(entry => [identity(entry), entry]));
    for (const entry of entries) {
      const old = known.get(identity(entry));
      const picture = old?.element.querySelector(".pic img");
      if (picture) {
        entry.picture = null;
        entry.element.querySelector(".pic").replaceChildren(picture);
      }
      if (chosen.delete(old)) chosen.add(entry);
      if (old && old === current) current = entry;
    }
    const there = new Set(entries);
    for (const entry of chosen) if (!there.has(entry)) chosen.delete(entry);
    if (!there.has(current)) current = null;
  };
  const goOnTyping = () => {
    // The box lost the focus because it was replaced, not because the user left it.
    if (!left || left.box.isConnected || performance.now() - left.at > 100 || document.activeElement !== document.body) return;
    const box = field(`.${left.box.className}`);
    Object.assign(box, {value: left.value, hidden: false});
    box.focus();
    if (box.matches(".search")) rearranged();
  };

  const begin = found => {
    const before = onPage ? entries : [], top = scrolled;
    grid = found;
    bar = document.querySelector(".gallery-bar");
    onPage = !!grid.closest(".gallery-pane");
    state = from = null;
    inSight.clear();
    entries = all(".gallery-grid .entry").map(element => ({
      element, key: element.dataset.key, words: element.dataset.words, drawn: false, tags: [],
      values: JSON.parse(element.dataset.values), places: JSON.parse(element.dataset.places),
    }));
    for (const entry of entries) tagged(entry, JSON.parse(entry.element.dataset.tags));
    takeOver(before);
    showTags();
    arrange();
    if (!onPage) return;
    watchAll();
    field(".size").value = localStorage.getItem("gallery-tile") ?? (innerWidth < 1600 ? 200 : 260);
    resize();
    if (!before.length) return;
    showState();
    goOnTyping();
    grid.scrollTop = top;
  };
  const resize = () => document.documentElement.style.setProperty("--gallery-tile", `${field(".size").value}px`);
  let wasSeen = false;
  const isSeen = () => document.documentElement.dataset.preset === "gallery" && !!grid?.isConnected;
  const lookForOne = () => {
    const found = document.querySelector(".gallery-grid");
    if (found && found !== grid) begin(found);
    if (!grid?.isConnected || !onPage) return;
    showState();
    if (isSeen() && !wasSeen) moveTo(current);  // What is hidden cannot be scrolled to.
    wasSeen = isSeen();
  };
  new MutationObserver(lookForOne).observe(document, {subtree: true, childList: true});
  addEventListener("DOMContentLoaded", lookForOne);
  const entryAt = event => {
    const element = event.target.closest?.(".gallery-grid .entry");
    return element && entries.find(entry => entry.element === element);
  };

  // Mouse and boxes

  addEventListener("change", event => {
    if (!bar?.contains(event.target)) return;
    event.stopImmediatePropagation();
    if (event.target.matches("[data-by], .order")) rearranged();
    if (event.target.matches(".saved") && event.target.value) {
      const saved = state.filters[event.target.value];
      set({...saved, only: Object.entries(saved.only)});
      rearranged();
    }
    if (event.target.matches(".saved")) field(".drop").hidden = !event.target.value;
    if (event.target.matches("select, .size")) event.target.blur();
  }, true);
  addEventListener("input", event => {
    if (!bar?.contains(event.target)) return;
    if (event.target.matches(".search")) rearranged();
    if (!event.target.matches(".size")) return;
    resize();
    localStorage.setItem("gallery-tile", event.target.value);
  }, true);
  addEventListener("click", event => {
    if (!onPage && event.target.closest?.("a[href^='#card-']")) {  // A link to a card that is filtered out shows all.
      const entry = entries.find(entry => entry.element.id === event.target.closest("a").hash.slice(1));
      if (entry?.element.hidden) set({order: arrangement().order, only: [], search: ""});
    }
    const button = bar?.contains(event.target) && event.target.closest("button");
    if (button) {
      if (button.matches(".none")) { chosen.clear(); showChosen(); }
      if (button.dataset.tag) tag(button.dataset.tag, false);
      if (button.matches(".save")) { field(".filter-name").hidden = false; field(".filter-name").focus(); return; }
      if (button.matches(".drop")) tell("DeleteFilter", {name: field(".saved").value});
      button.blur();
    }
    const entry = onPage && entryAt(event);
    if (!entry) return;
    moveTo(entry, false);
    if (event.shiftKey) chooseTo(entry);
    else if (event.ctrlKey || event.metaKey) toggle(entry);
    else open(entry);
  }, true);

  // Keys; in boxes only those that leave them

  const inBox = event => {
    const box = event.target;
    if (event.key === "Enter" && box.matches(".tag") && box.value.trim()) { tag(box.value.trim(), true); box.value = ""; }
    if (event.key === "Enter" && box.matches(".filter-name") && box.value.trim()) {
      tell("SaveFilter", {name: box.value.trim(), ...arrangement()});
    }
    if (!["Enter", "Escape"].includes(event.key)) return;
    event.preventDefault();  // Escape would empty a box for searching.
    if (box.matches(".filter-name")) { box.value = ""; box.hidden = true; }
    box.blur();
  };
  const columns = () => {
    const top = shown[0]?.element.offsetTop;
    return Math.max(shown.findIndex(entry => entry.element.offsetTop !== top), 0) || shown.length;
  };
  const KEYS = {
    ArrowLeft: () => step(-1), ArrowRight: () => step(1), ArrowUp: () => step(-columns()), ArrowDown: () => step(columns()),
    Home: () => moveTo(shown[0]), End: () => moveTo(shown.at(-1)),
    Enter: () => open(current), x: () => current && toggle(current),
    Escape: () => { chosen.clear(); showChosen(); },
  };
  const step = by => {
    const to = shown.indexOf(current) + by;
    if (shown[to]) moveTo(shown[to]);
    else if (by > 1) moveTo(shown.at(-1));
  };
  addEventListener("keydown", event => {
    if (!grid?.isConnected || event.altKey) return;
    const stop = () => { event.preventDefault(); event.stopImmediatePropagation(); };
    if (bar.contains(event.target) && event.target.matches("input")) {
      event.stopImmediatePropagation();
      return inBox(event);
    }
    if (event.target.matches?.("input, textarea, select")) return;
    if ((event.ctrlKey || event.metaKey)) return;
    if (event.key === "/" && (!onPage || isSeen())) {
      stop();
      field(".search").focus();
    } else if (onPage && isSeen() && KEYS[event.key] && !event.target.closest?.("button, [role=tab]")) {
      stop();
      if (event.shiftKey && event.key.startsWith("Arrow")) { from ??= current; KEYS[event.key](); chooseTo(current); }
      else KEYS[event.key]();
    } else if (onPage && event.key === "Escape" && !isSeen() && !document.body.classList.contains("why")
        && !all(".vz .cancel a").some(link => link.offsetParent)) {
      stop();
      tell("ShowLayout", {preset: "gallery"});
    }
  }, true);
}
