"""Run :mod:`positioning.main`."""

import sys

from positioning.main import main

if __name__ == "__main__":
    sys.exit(main())
