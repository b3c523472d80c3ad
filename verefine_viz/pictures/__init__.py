"""Pictures that page, recordings and report share, each drawn by one module: score maps, search tree, answers.

What only the page draws (HTML and SVG with its commands) is in ``viewer/drawing``.
"""
