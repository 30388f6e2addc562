"""Run :mod:`accuracy.consistency`."""

import sys

from accuracy.consistency import main

if __name__ == "__main__":
    sys.exit(main())
