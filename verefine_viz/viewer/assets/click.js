// A click in a block of the page: puts the command of what was clicked into the hidden text field, which sends it.
const target = event.target.closest("[data-cmd]");
if (target) {
  const command = JSON.parse(target.dataset.cmd), box = target.getBoundingClientRect();
  if (target.dataset.crop) {
    const [u, v, width, height] = JSON.parse(target.dataset.crop);
    command.u = u + Math.floor((event.clientX - box.left) / box.width * width);
    command.v = v + Math.floor((event.clientY - box.top) / box.height * height);
  }
  if (target.dataset.cells) {
    const n = +target.dataset.cells;
    command.cursor = Math.min(n, 1 + Math.floor((event.clientX - box.left) / box.width * n));
  }
  const label = [...document.querySelectorAll("label")].find(e => e.textContent === "LINK_LABEL");
  const input = label && label.closest(".mantine-Flex-root").querySelector("input");
  if (input) {
    const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;
    set.call(input, JSON.stringify(command) + " " + Date.now());
    input.dispatchEvent(new Event("input", {bubbles: true}));
  }
}
