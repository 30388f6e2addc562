"""Run :mod:`accuracy.assumptions`."""

import sys

from accuracy.assumptions import main

if __name__ == "__main__":
    sys.exit(main())
