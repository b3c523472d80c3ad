"""HTML, SVG and pictures about a snapshot."""
