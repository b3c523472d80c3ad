// Runs before the modules of the page: mends what would keep them from starting, and says why where they cannot.
{
  // Charts write numbers in the browser's language; where the system has none (locale "C") to ask for them is an error.
  try {
    new Intl.NumberFormat(navigator.language);
  } catch {
    Object.defineProperty(navigator, "language", { value: "en" });
  }

  /** @param {string} why */
  const say = (why) => {
    if (document.readyState === "loading") {
      document.addEventListener("DOMContentLoaded", () => say(why), { once: true });
      return;
    }
    const page = document.getElementById("app");
    if (page.childElementCount) return; // the page stands: its panes say what fails in them
    const lines = [["h2", "The page cannot start"], ["p", why],
      ["p", `It runs in Chrome and Edge from 111, Firefox from 121, Safari from 16.4; this is ${navigator.userAgent}.`]];
    const words = document.createElement("div");
    words.className = "cannot-start";
    for (const [kind, text] of lines) words.append(Object.assign(document.createElement(kind), { textContent: text }));
    page.append(words);
  };
  addEventListener("error", (/** @type {Event} */ event) => {
    if (event instanceof ErrorEvent) say(`${event.message} (${event.filename}:${event.lineno})`);
    else if (event.target instanceof HTMLScriptElement) say(`${event.target.src || "A module"} cannot be loaded.`);
  }, true);
  addEventListener("unhandledrejection", (event) => say(String(event.reason?.message ?? event.reason)));
}
