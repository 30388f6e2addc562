"""Run :mod:`speed.report`."""

import sys

from speed.report import main

if __name__ == "__main__":
    sys.exit(main())
