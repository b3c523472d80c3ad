"""``python -m verefine_viz``, the command line."""

import sys

from verefine_viz.cli import main

if __name__ == "__main__":
    sys.exit(main())
