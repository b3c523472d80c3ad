"""Ground truth made by a person and verified by the program: placed, refined, settled, carried on, written."""
