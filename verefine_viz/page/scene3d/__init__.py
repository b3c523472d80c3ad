"""The 3D view: viser, handed through by the page's server."""
