// The image pane: zoom, wipe, opacity and legend are this browser's own, and are held in variables and attributes of the
// document. So they outlast every picture that the program sends. The pixel under the mouse is shown in the photo and
// in all score maps, with its numbers, without asking the program.
{
  const root = document.documentElement, style = document.createElement("style"), hidden = new Set();
  const view = {of: "", scale: 1, x: 0, y: 0, width: 0, height: 0, moved: false};
  const NO_NUMBER = -(2 ** 31);
  const pane = () => [...document.querySelectorAll(".image-view")].find(e => e.offsetParent);
  const numbers = (element, name) => JSON.parse(element.dataset[name]);

  // Where the image is

  const place = (scale, x, y) => {
    Object.assign(view, {scale, x, y});
    root.style.setProperty("--image-scale", scale);
    root.style.setProperty("--image-x", `${x}px`);
    root.style.setProperty("--image-y", `${y}px`);
  };
  const fit = () => {
    const frame = numbers(pane(), "frame"), [u, v, width, height] = "imageWhole" in root.dataset ? frame : numbers(pane(), "area");
    const scale = Math.min(view.width / width, view.height / height);
    // The middle of the area in the middle of the pane; but nothing beside the image where there is enough of it.
    const start = (size, shown, middle) =>
      scale * size > shown ? Math.min(Math.max(shown / 2 - scale * middle, shown - scale * size), 0) : (shown - scale * size) / 2;
    view.moved = false;
    place(scale, start(frame[2], view.width, u + width / 2), start(frame[3], view.height, v + height / 2));
  };
  const zoom = (factor, x, y) => {
    const scale = Math.min(Math.max(view.scale * factor, 0.1), 60), by = scale / view.scale;
    view.moved = true;
    place(scale, x - (x - view.x) * by, y - (y - view.y) * by);
  };

  // After every change of the page: another object or size is fitted in, and a new bar shows what is chosen here

  const catchUp = () => {
    const shown = pane();
    if (!shown) return;
    const {of} = shown.dataset, {width, height} = shown.getBoundingClientRect();
    if (of !== view.of || (!view.moved && (width !== view.width || height !== view.height))) {
      Object.assign(view, {of, width, height});
      if (width && height) fit();
    } else if (width !== view.width || height !== view.height) {
      const x = view.x + (width - view.width) / 2, y = view.y + (height - view.height) / 2;
      Object.assign(view, {width, height});
      place(view.scale, x, y);
    }
    const bar = shown.parentElement.querySelector(".image-bar");
    if (!bar.dataset.ready) {
      bar.dataset.ready = "yes";
      bar.querySelector("input").value = 100 * opacity();
      const chosen = bar.querySelector("[data-chosen]");
      bar.querySelector("select").value = "imageMap" in root.dataset && chosen ? chosen.value : "none";
      sizes.disconnect();
      sizes.observe(shown);
    }
    point();
  };
  const opacity = () => +(root.style.getPropertyValue("--image-opacity") || 0.35);
  let waits = false;
  const soon = () => {
    if (waits) return;
    waits = true;
    requestAnimationFrame(() => { waits = false; catchUp(); });
  };
  const sizes = new ResizeObserver(soon);
  new MutationObserver(soon).observe(document, {subtree: true, childList: true});

  // Mouse

  let drag = null;
  const toggle = name => name in root.dataset ? delete root.dataset[name] : root.dataset[name] = "";
  addEventListener("wheel", event => {
    const shown = event.target.closest?.(".image-view");
    if (!shown) return;
    const box = shown.getBoundingClientRect();
    event.preventDefault();
    zoom(Math.exp(-0.0016 * event.deltaY), event.clientX - box.left, event.clientY - box.top);
    soon();
  }, {passive: false, capture: true});
  addEventListener("pointerdown", event => {
    const shown = event.target.closest?.(".image-view");
    if (shown && event.button === 0) {
      drag = {wipe: event.target.matches(".image-wipe"), x: event.clientX, y: event.clientY, far: false};
    }
  }, true);
  addEventListener("pointermove", event => {
    if (!event.buttons) drag = null;  // It ended outside of the window.
    const shown = drag && pane();
    if (shown) {
      const dx = event.clientX - drag.x, dy = event.clientY - drag.y, box = shown.getBoundingClientRect();
      drag.far ||= Math.hypot(dx, dy) > 3;
      if (drag.wipe) {
        const share = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
        root.style.setProperty("--image-wipe", share);
      } else if (drag.far) {
        view.moved = true;
        place(view.scale, view.x + dx, view.y + dy);
        Object.assign(drag, {x: event.clientX, y: event.clientY});
      }
    }
    hover = under(event);
    soonPoint();
  }, true);
  addEventListener("pointerup", () => { if (drag && !drag.far && !drag.wipe) drag = null; }, true);
  addEventListener("click", event => {
    if (drag) {  // The end of a drag is no click on a pixel.
      event.stopImmediatePropagation();
      drag = null;
      return;
    }
    const key = event.target.closest?.(".image-key")?.dataset.key;
    if (key) {
      if (!hidden.delete(key)) hidden.add(key);
      style.textContent = [...hidden].map(k => `[data-contour="${k}"]{display:none}[data-key="${k}"]{opacity:.4}`).join("");
      if (!style.isConnected) document.head.append(style);
    }
    // Keys are for the page, not for what was clicked last; who moves by keys keeps the focus.
    if (event.detail > 0) event.target.closest?.(".image-bar button, .image-key")?.blur();
    const act = event.target.closest?.("[data-image]")?.dataset.image;
    if (act === "wipe") toggle("imageWipe");
    if (act === "whole") {
      toggle("imageWhole");
      fit();
    }
  }, true);
  addEventListener("dblclick", event => {
    const shown = event.target.closest?.(".image-view");
    if (!shown) return;
    if (view.moved) fit();
    else shown.dispatchEvent(new CustomEvent("maximise", {bubbles: true}));
  }, true);
  addEventListener("input", event => {
    if (event.target.closest?.(".image-bar") && event.target.matches("input")) {
      root.style.setProperty("--image-opacity", event.target.value / 100);
    }
  }, true);
  addEventListener("change", event => {
    if (event.target.closest?.(".image-bar")) event.target.blur();
    if (!event.target.matches?.(".image-map")) return;
    if (event.target.value === "none") {
      delete root.dataset.imageMap;
      event.stopImmediatePropagation();
    } else {
      root.dataset.imageMap = "";
    }
  }, true);

  // The pixel under the mouse: crosses in the photo and in all score maps, and its numbers

  let hover = null, pointing = false;
  const PICTURES = ".vz img[data-crop], .image-hit";
  const under = event => {
    const picture = event.target.closest?.(".image-view")?.querySelector(".image-hit")
      ?? event.target.closest?.(".vz img[data-crop]");
    if (!picture) return null;
    const box = picture.getBoundingClientRect(), [u, v, width, height] = numbers(picture, "crop");
    // A click comes with whole numbers: the same pixel is to be shown before it.
    const x = Math.floor(event.clientX) - box.left, y = Math.floor(event.clientY) - box.top;
    return {u: u + Math.floor(x / box.width * width), v: v + Math.floor(y / box.height * height)};
  };
  const crosses = [];
  const soonPoint = () => {
    if (pointing) return;
    pointing = true;
    requestAnimationFrame(() => { pointing = false; point(); });
  };
  const point = () => {
    let used = 0;
    for (const picture of hover ? document.querySelectorAll(PICTURES) : []) {
      const box = picture.getBoundingClientRect(), [u, v, width, height] = numbers(picture, "crop");
      const across = (hover.u + 0.5 - u) / width, down = (hover.v + 0.5 - v) / height;
      if (!(across > 0 && across < 1 && down > 0 && down < 1)) continue;
      const x = box.left + across * box.width, y = box.top + down * box.height, top = document.elementFromPoint(x, y);
      if (!top || !(top === picture || (picture.matches(".image-hit") && top.closest(".image-view")))) continue;
      const cross = crosses[used] ??= Object.assign(document.createElement("div"), {className: "image-cross"});
      cross.style.left = `${x}px`;
      cross.style.top = `${y}px`;
      if (!cross.isConnected) document.body.append(cross);
      used++;
    }
    for (const cross of crosses.slice(used)) cross.remove();
    readOut();
  };

  // Numbers are unpacked when they are first asked for, and again after every change.

  const unpacked = new WeakMap();
  const unpack = (element, packed) => {
    const known = unpacked.get(element);
    if (known) return known.length ? known : null;
    unpacked.set(element, []);
    const bytes = Uint8Array.from(atob(packed), c => c.charCodeAt(0));
    new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer().then(all => {
      unpacked.set(element, new Int32Array(all));
      soonPoint();
    });
    return null;
  };
  const inUnits = (number, digits, unit) =>
    number === undefined || number === NO_NUMBER ? "–" : (number / 10 ** digits).toFixed(digits) + unit;
  const readOut = () => {
    const shown = pane();
    if (!shown) return;
    const [, , width, height] = numbers(shown, "frame");
    const {u, v} = hover ?? {};
    // Only what differs is written: every change of the page has the pixel pointed at again.
    const say = text => {
      for (const words of document.querySelectorAll(".image-readout, .maps-readout")) {
        if (words.textContent !== text) words.textContent = text;
      }
    };
    if (!hover || u < 0 || v < 0 || u >= width || v >= height) return say("");
    const photo = document.querySelector(".photo [data-depth]"), own = document.querySelector(".numbers [data-numbers]");
    const depth = photo && unpack(photo, photo.dataset.depth);
    const observed = depth?.[v * width + u];
    const [u0, v0, w, h] = own ? numbers(own, "area") : [0, 0, 0, 0];
    let of = [undefined, undefined, undefined, 0];
    if (own && u >= u0 && v >= v0 && u < u0 + w && v < v0 + h) {
      const all = unpack(own, own.dataset.numbers);
      if (all) of = [0, 1, 2, 3].map(k => all[(k * h + v - v0) * w + u - u0]);
    }
    say([
      `${u}, ${v}`, `observed ${inUnits(observed, 4, "")}`, `rendered ${inUnits(of[0], 4, " m")}`,
      `Δ ${inUnits(of[1], 1, " mm")}`, `${inUnits(of[2], 1, "°")}`, numbers(shown, "classes")[of[3]],
    ].join(" · "));
  };
}
