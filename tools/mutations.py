"""Run :mod:`mutations.main`."""

import sys

from mutations.main import main

if __name__ == "__main__":
    sys.exit(main())
