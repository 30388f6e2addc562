"""Run :mod:`speed.paired`."""

import sys

from speed.paired import main

if __name__ == "__main__":
    sys.exit(main())
