"""Run :mod:`accuracy.geometry`."""

import sys

from accuracy.geometry import main

if __name__ == "__main__":
    sys.exit(main())
