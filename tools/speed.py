"""Run :mod:`speed.main`."""

import sys

from speed.main import main

if __name__ == "__main__":
    sys.exit(main())
