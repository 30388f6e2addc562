"""Run :mod:`accuracy.curves`."""

import sys

from accuracy.curves import main

if __name__ == "__main__":
    sys.exit(main())
