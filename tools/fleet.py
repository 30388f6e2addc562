"""Run :mod:`fleet.main`."""

import sys

from fleet.main import main

if __name__ == "__main__":
    sys.exit(main())
