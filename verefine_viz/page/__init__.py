"""The page in the browser: its server, what is open, and the views that answer it."""
