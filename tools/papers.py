"""Run :mod:`papers.main`."""

import sys

from papers.main import main

if __name__ == "__main__":
    sys.exit(main())
