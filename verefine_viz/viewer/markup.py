"""HTML for the panels: escaped text, tables, and links that carry a command.

The GUI library shows HTML as it is, so everything that comes from data goes through :func:`text` first. A link holds a
command as JSON; :data:`HANDLERS` puts it into a hidden text field, which is how it reaches Python. Only commands of
:mod:`verefine_viz.viewer.commands` get through there.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence

from verefine_viz.core.palette import RGB
from verefine_viz.viewer.command import Command
from verefine_viz.viewer.command_lines import to_json

LINK_LABEL = "page link"
"""Label of the hidden text field."""

HANDLERS = """
{
  const send = command => {
    const label = [...document.querySelectorAll("label")].find(label => label.textContent === "LABEL");
    const input = label?.closest(".mantine-Flex-root").querySelector("input");
    if (!input) return;
    const value = `${JSON.stringify(command)} ${Date.now()}`;
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(input, value);
    input.dispatchEvent(new Event("input", {bubbles: true}));
  };
  const at = (event, selector) => event.target instanceof Element ? event.target.closest(selector) : null;
  document.addEventListener("click", event => {
    at(event, ".vz .fold")?.classList.toggle("folded");
    const link = at(event, ".vz [data-cmd]");
    if (!link) return;
    const command = JSON.parse(link.dataset.cmd), box = link.getBoundingClientRect();
    const across = (event.clientX - box.left) / box.width, down = (event.clientY - box.top) / box.height;
    if (link.dataset.crop) {
      const [u, v, width, height] = JSON.parse(link.dataset.crop);
      command.u = u + Math.floor(across * width);
      command.v = v + Math.floor(down * height);
    }
    if (link.dataset.cells) command.cursor = Math.min(+link.dataset.cells, 1 + Math.floor(across * link.dataset.cells));
    send(command);
  }, true);
  document.addEventListener("change", event => {
    const list = at(event, ".vz select");
    if (list) send(JSON.parse(list.value));
  }, true);
  // The animation starts whenever the mark comes to another card: the one time at which it may have to come into sight.
  document.addEventListener("animationstart", event => {
    at(event, ".vz .card.marked")?.scrollIntoView({block: "nearest"});
  }, true);
}
""".replace("LABEL", LINK_LABEL)
"""A script for the page: clicks on links, choices from lists, what unfolds. Handlers within HTML do not run there."""


def text(value: object) -> str:
    """Anything as text that HTML cannot misread."""
    return html.escape(str(value), quote=True)


def block(content: str, css_class: str = "") -> str:
    """The whole content of one HTML widget; links inside work."""
    return f'<div class="vz {css_class}">{content}</div>'


def carries(command: Command) -> str:
    """Attributes that make an element send ``command`` when it is clicked."""
    return f'data-cmd="{text(to_json(command))}"'


def link(label: str, command: Command, title: str = "") -> str:
    """A piece of text to click; ``label`` is escaped here."""
    return f'<a {carries(command)} title="{text(title)}">{text(label)}</a>'


def swatch(color: RGB, title: str = "") -> str:
    """A small square in a colour that means something."""
    return f'<i class="sw" style="background:rgb{color}" title="{text(title)}"></i>'


def table(head: Sequence[tuple[str, str]], rows: Sequence[Row]) -> str:
    """A table: ``head`` holds (label, tooltip) per column."""
    titles = "".join(f'<th title="{text(tip)}">{text(label)}</th>' for label, tip in head)
    return f"<table><thead><tr>{titles}</tr></thead><tbody>{''.join(r.html for r in rows)}</tbody></table>"


class Row:
    """One row: cells are ready HTML; ``command`` makes the whole row a link; ``marked`` makes it stand out; ``parted``
    draws a line above it.
    """

    def __init__(
        self, cells: Sequence[str], command: Command | None = None, marked: bool = False, parted: bool = False
    ) -> None:
        attributes = carries(command) if command else ""
        name = " ".join(["marked"] * marked + ["parted"] * parted)
        self.html = f'<tr class="{name}" {attributes}>{"".join(f"<td>{c}</td>" for c in cells)}</tr>'


def sentence(content: str) -> str:
    """The words at the top of a panel; ``content`` is escaped here."""
    return f'<p class="say">{text(content)}</p>'


def with_hints(content: str, hints: Mapping[str, str]) -> str:
    """Words that are escaped here, the first of each of the ``hints`` with its tooltip."""
    said = text(content)
    for word, hint in hints.items():
        found = re.search(rf"\b{re.escape(text(word))}\b", said, re.IGNORECASE)
        if found:
            said = (
                f'{said[: found.start()]}<span class="term" title="{text(hint)}">{found[0]}</span>{said[found.end() :]}'
            )
    return said


def hinted(content: str, hints: Mapping[str, str]) -> str:
    """The words at the top of a panel, with tooltips."""
    return f'<p class="say">{with_hints(content, hints)}</p>'


def note(content: str) -> str:
    """A box with something good to know."""
    return f'<p class="note">{text(content)}</p>'


def warning(content: str, extra: str = "", red: bool = False, folded: bool = False) -> str:
    """A box with something to act on; ``extra`` is ready HTML, such as a link. ``folded``: one line until a click."""
    name = "bad" if red else "warn"
    if folded:
        return f'<p class="{name} fold folded" title="{text(content)}">{text(content)} {extra}</p>'
    return f'<p class="{name}">{text(content)} {extra}</p>'


# About the docked panels: the library slides a column to its place when the window gets wider, and leaves it beside the
# screen; it gives both rows the same height, until a person moves the border; and its scrollbars lie on the content.
STYLE = """<style>
.vz{font-size:12.5px;line-height:1.38;padding:0 10px 6px 10px;color:inherit}
.vz.tight{padding-bottom:0}
.vz p{margin:0 0 6px 0}
.vz p.say{font-size:13px}
.vz.brief p.say{font-size:11.5px;line-height:1.3;margin-bottom:4px}
.vz p.warn,.vz p.bad,.vz p.note{padding:4px 7px;border-radius:4px;border-left:3px solid #d98e04;
 background:rgba(217,142,4,.12);overflow-wrap:anywhere}
.vz p.bad{border-color:#dc322f;background:rgba(220,50,47,.12)}
.vz p.fold{cursor:pointer}
.vz p.fold::before{content:'▾ '}
.vz p.folded{white-space:nowrap;overflow:hidden;text-overflow:ellipsis}
.vz p.folded::before{content:'▸ '}
.vz .top>p.bad{max-height:calc(7.6em + 8px);overflow-y:auto}
.vz .top>p.fold~p.bad:not(.fold){max-height:calc(4.6em + 8px)}
.vz .top>p.folded{overflow:hidden}
.vz p.note{border-color:#1c7ed6;background:rgba(28,126,214,.12)}
.vz code{overflow-wrap:anywhere}
.vz p.dim,.vz .dim{opacity:.65}
.vz .term{text-decoration:underline dotted;text-underline-offset:3px;cursor:help}
.vz a{color:#1c7ed6;cursor:pointer;text-decoration:underline;text-underline-offset:2px}
.vz table{border-collapse:collapse;width:100%;font-size:12px;font-variant-numeric:tabular-nums;margin:0 0 6px 0}
.vz th{font-weight:600;text-align:right;padding:1px 4px;border-bottom:1px solid rgba(128,128,128,.5);cursor:help;
 white-space:nowrap}
.vz td{text-align:right;padding:0 4px;line-height:1.3;border-bottom:1px solid rgba(128,128,128,.15);white-space:nowrap}
.vz th:first-child,.vz td:first-child{text-align:left}
.vz tr[data-cmd]{cursor:pointer}
.vz tr[data-cmd]:hover{background:rgba(28,126,214,.12)}
.vz tr.marked{background:rgba(40,200,80,.18)}
.vz .sw{display:inline-block;width:10px;height:10px;border-radius:2px;margin-right:5px;
 border:1px solid rgba(0,0,0,.35);vertical-align:-1px}
.vz.names td:first-child,.vz.names th:first-child,
.vz.objects td:nth-child(2){max-width:0;width:99%;overflow:hidden;text-overflow:ellipsis}
.vz.objects td,.vz.objects th,.vz.errors td,.vz.errors th{padding-inline:3px}
.vz.objects td:nth-child(2),.vz.objects th:nth-child(2){text-align:left}
.vz tr.parted td{border-top:1.5px solid rgba(200,200,200,.65)}
.vz .sinks{color:#d98e04;cursor:help}
.vz p.legend{font-size:11px;margin:0 0 2px 0}
.vz .light{display:inline-block;width:10px;height:10px;border-radius:5px;vertical-align:-1px}
.vz .bar{display:inline-block;height:8px;vertical-align:0;margin-right:1px}
.vz img{image-rendering:pixelated;display:block;width:100%}
.vz img[data-cmd]{cursor:crosshair}
.vz .cut{display:inline-block;max-width:104px;overflow:hidden;text-overflow:ellipsis;vertical-align:bottom}
.vz .numbered{display:inline-flex}
.vz .numbered>span{min-width:0;overflow:hidden;text-overflow:ellipsis}
.vz .numbered>.sw{flex:none;align-self:center}
.vz .numbered>b{flex:none;margin-right:4px}
.vz td>.numbered{max-width:100%}
.vz .cb{height:7px;border-radius:2px;margin-top:3px}
.vz .ticks{display:flex;justify-content:space-between;font-size:10px;opacity:.8;line-height:1.2}
.vz.strip table{table-layout:fixed;margin:0}
.vz.strip td,.vz.strip th{padding:1px 2px;border:0;text-align:center}
.vz.strip td:first-child,.vz.strip th:first-child{width:72px;text-align:left;white-space:normal;font-size:11.5px}
.vz.strip th.whose{white-space:nowrap}
.vz .curves{display:flex;gap:6px;font-size:11px;margin-bottom:-8px;white-space:nowrap}
.vz .curves>span{overflow:hidden;text-overflow:ellipsis;min-width:0}
.vz .curves>.what{flex-shrink:1000000}
.vz .curves .sw{margin-right:3px}
.vz .curves.many{flex-wrap:wrap;row-gap:0}
.vz .curves.many>.who{flex:0 0 100%;display:flex;flex-wrap:wrap;column-gap:4px;justify-content:space-between}
.vz .curves.many .cut{max-width:170px!important}
.vz .curves.many .sw{width:8px;height:8px;margin-right:2px;vertical-align:0}
.vz.line svg{display:block;width:100%}
.vz.line [data-cmd]{cursor:pointer}
.vz.line .head{font-size:12px;white-space:nowrap;overflow:hidden;text-overflow:ellipsis}
.vz.line .colors{display:flex;gap:12px;justify-content:space-between;font-size:11px;white-space:nowrap}
.vz.line .legend{display:flex;gap:7px;cursor:help}
.vz.line .blocks{display:flex;gap:6px;min-width:0;overflow:hidden}
.vz.line .blocks>span{flex:0 1 auto;min-width:26px;overflow:hidden;text-overflow:ellipsis}
.vz.line .blocks .cut{display:inline}
[data-dock-tab]{padding:0 7px!important}
[data-dock-region=right] .mantine-ScrollArea-content{padding-right:4px}
[data-dock-column]{transform:none!important}
[data-dock-region=right] div[style*="flex: 0.5 1"]{flex-grow:.43!important}
[data-dock-region=right] div[style*="flex: 0.5 1"]:has([data-dock-tab]){flex-grow:.57!important}
#webgl-software-rendering{display:none}
</style>"""
