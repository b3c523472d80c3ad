"""The web server, and what runs in the browser beside the GUI library's own page."""
