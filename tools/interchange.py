"""Run :mod:`interchange.main`."""

import sys

from interchange.main import main

if __name__ == "__main__":
    sys.exit(main())
