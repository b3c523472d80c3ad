"""What a browser reads of what is sent to it."""

from __future__ import annotations

from typing import Any

import msgspec

from verefine_viz.page.protocol import encoded
from verefine_viz.page.wire import Part


def received(sent: Part) -> dict[str, Any]:
    """Return a message, an answer or a part of one as JSON has it; its keys and types are those of the struct."""
    text = encoded(sent)
    msgspec.json.decode(text, type=type(sent))
    return msgspec.json.decode(text)
