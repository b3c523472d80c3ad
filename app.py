"""The page in the browser: ``python app.py [SESSION]``, the same as ``verefine-viz view [SESSION]``."""

import sys

from verefine_viz.cli import main

if __name__ == "__main__":
    sys.exit(main(["view", *sys.argv[1:]]))
