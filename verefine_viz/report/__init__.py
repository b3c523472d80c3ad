"""The report of a batch: one HTML file that says how good it is, where it fails, and why."""
