"""Run :mod:`accuracy.changes`."""

import sys

from accuracy.changes import main

if __name__ == "__main__":
    sys.exit(main())
