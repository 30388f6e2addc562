"""Run :mod:`robustness.main`."""

import sys

from robustness.main import main

if __name__ == "__main__":
    sys.exit(main())
