"""Run :mod:`accuracy.two_axles`."""

import sys

from accuracy.two_axles import main

if __name__ == "__main__":
    sys.exit(main())
