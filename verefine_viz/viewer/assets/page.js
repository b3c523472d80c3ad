// What the page does by itself; it is served before viser's own scripts. Handlers within the blocks' HTML are avoided:
// one listener per kind of event serves all blocks. `web/server.py` fills in the words in capitals.

// viser's page unpacks its program and puts it into one script element; nothing else that is written into the page runs.
document.createElement = function (name, options) {
  const made = Document.prototype.createElement.call(this, name, options);
  if (name === "script") {
    made.nonce = "NONCE";
    delete document.createElement;
  }
  return made;
};
// The library's sorter of Gaussian splats, of which we have none, wants to evaluate text as a program, and may not.
addEventListener("unhandledrejection", event => {
  if (event.reason instanceof EvalError) event.preventDefault();
});

// Without a GPU smooth edges take a third of the time of every picture, and a step waits for it.
{
  const probe = document.createElement("canvas").getContext("webgl2");
  const names = probe?.getExtension("WEBGL_debug_renderer_info");
  const renderer = probe?.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : probe.RENDERER) ?? "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  if (/SOFTWARE_RENDERERS/i.test(renderer)) {
    const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
      return get.call(this, kind, kind.startsWith("webgl") ? {...options, antialias: false} : options);
    };
    // viser would go over to fewer pixels by itself after some slow pictures, and seldom come back.
    const held = setInterval(() => {
      const settings = window.__viserTestpoints?.devSettings;
      if (!settings) return;
      clearInterval(held);
      if (settings.get().fixedDpr === null) settings.set({fixedDpr: window.devicePixelRatio});
    }, 500);
  }
}

// Links: the command of what was clicked goes into a hidden text field, which is how it reaches Python.
{
  const waiting = [];
  const APART_MS = 80;  // Of two changes of a field within 50 ms viser sends one.
  let busy = false;
  const field = () => [...document.querySelectorAll("label")]
    .find(label => label.textContent === "LINK_LABEL")?.closest(".mantine-Flex-root").querySelector("input");
  const send = command => {  // Whether it goes its way; not before the page is connected.
    if (!field()) return false;
    waiting.push(command);
    if (!busy) sendNext();
    return true;
  };
  const sendNext = () => {
    busy = waiting.length > 0;
    if (!busy) return;
    write(waiting.shift());
    setTimeout(sendNext, APART_MS);
  };
  const write = command => {
    const input = field(), value = `${JSON.stringify(command)} ${Date.now()}`;
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(input, value);
    input.dispatchEvent(new Event("input", {bubbles: true}));
  };
  // With the button held, a strip of frames opens what the mouse is over; of what waits only the last.
  let scrubbed = null;
  document.addEventListener("pointerdown", event => {
    scrubbed = event.target.closest?.(".vz [data-scrub] [data-cmd]")?.dataset.cmd ?? null;
  }, true);
  document.addEventListener("pointerup", () => { scrubbed = null; }, true);
  document.addEventListener("pointermove", event => {
    if (scrubbed === null) return;
    const over = document.elementFromPoint(event.clientX, event.clientY)?.closest(".vz [data-scrub] [data-cmd]");
    if (!over || over.dataset.cmd === scrubbed) return;
    scrubbed = over.dataset.cmd;
    const command = JSON.parse(scrubbed);
    if (waiting.at(-1)?.command === command.command) waiting.pop();
    send(command);
  }, true);
  document.addEventListener("command", event => send(event.detail) || event.preventDefault());

  document.addEventListener("click", event => {
    // What the verdict rests on stays open while its content changes, until a click beside it.
    if (event.target.closest(".vz.verdict .why")) document.body.classList.toggle("why");
    else if (!event.target.closest(".vz.verdict .because")) document.body.classList.remove("why");
    event.target.closest(".vz .fold")?.classList.toggle("folded");
    const link = event.target.closest(".vz [data-cmd]");
    if (!link) return;
    const command = JSON.parse(link.dataset.cmd), box = link.getBoundingClientRect();
    const across = (event.clientX - box.left) / box.width, down = (event.clientY - box.top) / box.height;
    if (command.command === "ProbePixel") openTab("Score");  // Which has the pixel's numbers.
    if (link.dataset.crop) {  // A picture: the pixel that was clicked.
      const [u, v, width, height] = JSON.parse(link.dataset.crop);
      command.u = u + Math.floor(across * width);
      command.v = v + Math.floor(down * height);
    }
    if (link.dataset.cells) {  // A strip of iterations.
      command.cursor = Math.min(+link.dataset.cells, 1 + Math.floor(across * link.dataset.cells));
    }
    send(command);
  }, true);

  // A pane is enlarged by two clicks on its head, or one on the sign there; the image also asks for it itself.
  const enlarge = event => {
    const command = event.target.closest("[data-floating-window]")?.querySelector("[data-double]");
    if (command) send(JSON.parse(command.dataset.double));
  };
  const head = event => event.target.closest?.("[data-holds=image] [data-dock-strip], [data-holds='3D'] [data-dock-strip]");
  document.addEventListener("maximise", enlarge);
  document.addEventListener("dblclick", event => head(event) && enlarge(event), true);
  document.addEventListener("click", event => {
    const strip = head(event);
    if (strip && event.clientX > strip.getBoundingClientRect().right - 24 && event.detail === 1) enlarge(event);
  }, true);
  // Nor is it dragged away: its place is that of the layout.
  document.addEventListener("pointerdown", event => head(event) && event.stopPropagation(), true);

  // A layout that needs a tab of the right column opens it; the mark is animated when it appears, and only then.
  const openTab = (name, of = "[data-dock-region=right]") => {
    const tabs = [...document.querySelectorAll(`${of} [data-dock-tab]`)];
    const tab = tabs.find(tab => tab.textContent === name);
    tab?.dispatchEvent(new KeyboardEvent("keydown", {key: "Enter", bubbles: true}));
  };
  document.addEventListener("animationstart", event => {
    if (event.animationName !== "opens-tab") return;
    const {tab, of} = event.target.dataset;
    openTab(tab, of && `[data-holds=${of}]`);
  }, true);

  // A list of commands to choose from.
  document.addEventListener("change", event => {
    if (event.target.matches(".vz select")) send(JSON.parse(event.target.value));
  }, true);
}

// What has a height of its own in viser: a chart gets that of its pane, and Run what its content needs, in steps, so that
// the tabs below it seldom move.
let runHeight = 0;
setInterval(() => {
  const run = document.querySelector("[data-dock-region=right] .mantine-ScrollArea-content");
  const needed = 30 + 8 * Math.ceil((run?.offsetHeight ?? 0) / 8);
  if (needed > runHeight || needed < runHeight - 16) {
    runHeight = needed;
    document.documentElement.style.setProperty("--run-content", `${needed}px`);
  }
  for (const {chart} of Object.values(window.__viserTestpoints?.uplots ?? {})) {
    const pane = chart.root.closest("[data-holds=corner]");
    if (!pane || !chart.root.offsetParent) continue;
    const height = Math.round(pane.getBoundingClientRect().bottom - chart.root.getBoundingClientRect().top - 10);
    if (height >= 60 && height !== chart.height) chart.setSize({width: chart.width, height});
  }
}, 400);

// Score maps are enlarged together, about the pixel under the cursor: the wheel, and a double click to go back.
{
  let zoom = 1, left = 0, top = 0;  // What of a tile is seen, in shares of its size.
  const show = () => {
    const style = document.documentElement.style;
    style.setProperty("--map-zoom", zoom);
    style.setProperty("--map-x", `${-100 * left * zoom}%`);
    style.setProperty("--map-y", `${-100 * top * zoom}%`);
  };
  document.addEventListener("wheel", event => {
    const tile = event.target.closest(".vz .map .tile");
    if (!tile || event.shiftKey) return;
    event.preventDefault();
    const box = tile.getBoundingClientRect(), before = zoom;
    const across = (event.clientX - box.left) / box.width, down = (event.clientY - box.top) / box.height;
    zoom = Math.min(Math.max(zoom * (event.deltaY < 0 ? 1.25 : 0.8), 1), 12);
    left = Math.min(Math.max(left + across / before - across / zoom, 0), 1 - 1 / zoom);
    top = Math.min(Math.max(top + down / before - down / zoom, 0), 1 - 1 / zoom);
    show();
  }, {passive: false, capture: true});
  document.addEventListener("dblclick", event => {
    if (!event.target.closest(".vz .map .tile")) return;
    zoom = 1, left = top = 0;
    show();
  }, true);
  // In the Maps layout they lie over each other, up to a line that is dragged.
  document.addEventListener("input", event => {
    const wipe = event.target.closest(".maps-wipe input");
    if (wipe) wipe.closest("[data-floating-window]").style.setProperty("--maps-wipe", wipe.value / 100);
  }, true);
}

// What buttons do, as the browser's own tooltips: the library's cover what lies below.
document.addEventListener("mouseover", event => {
  const button = event.target.closest("button:not([title])");
  const hints = button && document.querySelector(".vz [data-hints]");
  const hint = hints && JSON.parse(hints.dataset.hints)[button.textContent];
  if (hint) button.title = hint;
}, true);

// Keys where viser 1.1 ignores them; nothing of it reaches Python. viser leaves keys alone in boxes for text, and its
// tabs keep Space for themselves after a click on them.

// Escape cancels from any box.
addEventListener("keydown", event => {
  if (event.key === "Escape") document.body.classList.remove("why");
  if (event.key === "Escape" && event.target.matches("input, textarea, select")) {
    [...document.querySelectorAll(".vz .cancel a")].find(link => link.offsetParent)?.click();
  }
}, true);

// A click on a tab does not take the keys. A click that a key made has no detail: who moves by keys keeps the focus.
addEventListener("click", event => {
  const tab = event.detail > 0 && event.target.closest("[role=tab]");
  if (tab) setTimeout(() => tab.blur());
}, true);

// A press moves the camera by a share of the distance from what is looked at, or turns it by some degrees; held, it
// repeats. viser moves by the time since the last picture, which may be seconds: a tap threw the camera out of the
// scene. It listens on the document as well, but later; what handles keys inside of the page has had them by then.
{
  const turn = 0.0698, share = 0.04;  // 4 degrees in radians
  const moves = {
    KeyA: (camera, step) => camera.truck(-step, 0, false),
    KeyD: (camera, step) => camera.truck(step, 0, false),
    KeyW: (camera, step) => camera.dolly(step, false),
    KeyS: (camera, step) => camera.dolly(-step, false),
    KeyQ: (camera, step) => camera.elevate(-step, false),
    KeyE: (camera, step) => camera.elevate(step, false),
    ArrowLeft: camera => camera.rotate(-turn, 0, false),
    ArrowRight: camera => camera.rotate(turn, 0, false),
    ArrowUp: camera => camera.rotate(0, -turn, false),
    ArrowDown: camera => camera.rotate(0, turn, false),
  };
  document.addEventListener("keydown", event => {
    const camera = window.__viserMutable?.cameraControl;
    if (!moves[event.code] || !camera || event.target.matches("input, textarea, select")) return;
    event.stopImmediatePropagation();
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || !camera.enabled) return;
    moves[event.code](camera, share * camera.distance);
  });
}
