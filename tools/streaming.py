"""Run :mod:`streaming.main`."""

import sys

from streaming.main import main

if __name__ == "__main__":
    sys.exit(main())
