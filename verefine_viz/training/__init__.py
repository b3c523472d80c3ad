"""Training of the networks: synthetic views, losses, export. Needs the extra ``torch``."""
