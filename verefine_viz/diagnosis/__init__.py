"""Why a pose came out wrong, decided by comparing the run with what ground truth would have made of it."""
