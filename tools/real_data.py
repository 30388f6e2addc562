"""Run :mod:`accuracy.real_data`."""

import sys

from accuracy.real_data import main

if __name__ == "__main__":
    sys.exit(main())
