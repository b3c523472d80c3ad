"""Step through 6D pose verification and physics-guided refinement, and see why an estimate won."""

__version__ = "0.1.0"
