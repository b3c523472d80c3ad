"""What the page does itself about keys where the library ignores them; nothing of it reaches Python.

The library leaves keys alone in boxes for text, and its tabs keep Space for themselves after a click on them.
"""

from __future__ import annotations

import html

CANCEL_CLASS = "cancel"
"""Class of the line with the link that Escape stands for."""

_ON_ESCAPE = (
    "window.addEventListener('keydown',e=>{if(e.key==='Escape'&&e.target.matches('input,textarea,select')){"
    f"const a=[...document.querySelectorAll('.vz .{CANCEL_CLASS} a')].find(a=>a.offsetParent);"
    "if(a)a.click();}},true);"
)
# A click that a key made has no detail: who moves by keys keeps the focus.
_ON_TAB = (
    "window.addEventListener('click',e=>{const t=e.detail>0&&e.target.closest('[role=tab]');"
    "if(t)setTimeout(()=>t.blur());},true);"
)


def page_keys() -> str:
    """HTML that sees to it that Escape cancels from any box, and that a click on a tab does not take the keys.

    Scripts in the library's HTML do not run; what is to be done when an image cannot be read does.
    """
    # Once is enough: a page outlives the program, and connects to the next one. In the handler of an image plain
    # addEventListener would be the image's own.
    script = f"if(!window.vzKeys){{window.vzKeys=true;{_ON_ESCAPE}{_ON_TAB}}}"
    return f'<img src="data:," alt="" style="display:none" onerror="{html.escape(script)}">'
