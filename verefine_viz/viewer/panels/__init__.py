"""One small class per panel: ``__init__(gui, send)`` builds widgets, ``show(view)`` updates them in place."""
