"""Run :mod:`first_hour.main`."""

import sys

from first_hour.main import main

if __name__ == "__main__":
    sys.exit(main())
