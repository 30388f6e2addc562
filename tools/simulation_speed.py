"""Run :mod:`speed.simulation`."""

import sys

from speed.simulation import main

if __name__ == "__main__":
    sys.exit(main())
