// Resolves names of libraries as a browser does: by the import map of index.html, to the vendored files.
// node --import ./tests/web/import_map.js --test "tests/web/*.test.js"
import { readFileSync } from "node:fs";
import { registerHooks } from "node:module";

const WEB = new URL("../../verefine_viz/page/web/", import.meta.url);
const page = readFileSync(new URL("index.html", WEB), "utf-8");
const { imports } = JSON.parse(/<script type="importmap">(.*?)<\/script>/s.exec(page)[1]);

registerHooks({
  resolve(name, context, next) {
    const resolved = next(name in imports ? new URL(imports[name].replace("/web/", "./"), WEB).href : name, context);
    return resolved.url.startsWith(WEB.href) ? { ...resolved, format: "module" } : resolved;
  },
});

// What modules of the page expect of a browser's window before anything is drawn.
Object.assign(globalThis, {
  location: { hash: "" },
  document: { title: "", documentElement: { dataset: { theme: "dark" } } },
  requestAnimationFrame: (work) => setImmediate(work),
});
