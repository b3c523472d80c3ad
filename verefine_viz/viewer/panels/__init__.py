"""One class per panel: ``__init__(gui, send)`` builds widgets, ``show(snapshot)`` updates them in place."""
