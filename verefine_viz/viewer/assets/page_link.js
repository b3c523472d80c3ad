// The page's address: what stands behind its # is opened when the page is loaded or the address changed, and follows
// what is shown. The button in the verdict bar has both that link and the number of the program that sent it.
{
  const mark = () => document.querySelector(".vz.verdict [data-link]");
  let asked = location.hash;  // What is to be opened; viser takes it from the address when it starts.
  let shown = null;  // The link that was last in the bar; null until the page is connected.

  const open = link => {  // Whether it was sent.
    const detail = {command: "OpenLink", link: link.slice(1)};
    return document.dispatchEvent(new CustomEvent("command", {detail, cancelable: true}));
  };

  setInterval(() => {
    const button = mark();
    if (!button) return;
    const {link, program} = button.dataset;
    // A page that is reloaded finds the program as it was; one that it did not show yet opens what its address says.
    const isKnown = sessionStorage.getItem("verefine-program") === program;
    if (asked && !isKnown && asked !== `#${link}` && !open(asked)) return;
    asked = "";
    sessionStorage.setItem("verefine-program", program);
    if (link === shown) return;
    shown = link;
    history.replaceState(null, "", `#${link}`);
  }, 400);

  addEventListener("hashchange", () => {
    if (mark() && location.hash && location.hash !== `#${mark().dataset.link}`) open(location.hash);
  });

  // Only pages of this machine and of https may write to the clipboard; others select a text and copy that.
  const copy = async text => {
    try {
      return await navigator.clipboard.writeText(text);
    } catch {}
    const box = Object.assign(document.createElement("textarea"), {value: text});
    document.body.append(box);
    box.select();
    document.execCommand("copy");
    box.remove();
  };
  document.addEventListener("click", async event => {
    const button = event.target.closest(".vz.verdict .copy-link");
    if (!button) return;
    await copy(`${location.origin}${location.pathname}${location.search}#${button.dataset.link}`);
    document.body.classList.add("copied");
    setTimeout(() => document.body.classList.remove("copied"), 1500);
  }, true);
}
