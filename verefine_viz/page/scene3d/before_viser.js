// Runs before viser's own page; viser_page.py fills in the words in capitals.
{
  // viser's page unpacks its program into one script element; nothing else that is written into the page runs.
  document.createElement = function (name, options) {
    const made = Document.prototype.createElement.call(this, name, options);
    if (name === "script") {
      made.nonce = "NONCE";
      delete document.createElement;
    }
    return made;
  };

  // viser's sorter of Gaussian splats, of which there are none, wants to evaluate text as a program, and may not.
  addEventListener("unhandledrejection", (event) => {
    if (event.reason instanceof EvalError) event.preventDefault();
  });

  // In a small pane viser would open its sheet for telephones, which covers half of the view.
  const matchMedia = window.matchMedia.bind(window);
  window.matchMedia = (query) => matchMedia(query.includes("max-width") ? "not all" : query);

  // The page around this one has bars, layers and notes of its own, and says what the ground looks like.
  const style = document.createElement("style");
  style.textContent = `#webgl-software-rendering, [data-floating-window], [data-dock-region], .mantine-Notifications-root,
    .mantine-Paper-root:has(> [aria-label="Show scene tree"]) { display: none !important } canvas[data-engine] { background: var(--ground, #141414) }`;
  document.head.append(style);

  // Without a GPU smooth edges take a third of the time of every picture.
  const probe = document.createElement("canvas").getContext("webgl2");
  const names = probe?.getExtension("WEBGL_debug_renderer_info");
  const renderer = probe?.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : probe.RENDERER) ?? "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  if (/SOFTWARE_RENDERERS/i.test(renderer)) {
    const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
      return get.call(this, kind, kind.startsWith("webgl") ? { ...options, antialias: false } : options);
    };
  }
}
