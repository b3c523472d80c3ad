"""What the page shows, as plain dicts: pure functions of a run, a file per view."""
