"""Run :mod:`accuracy.real_streams`."""

import sys

from accuracy.real_streams import main

if __name__ == "__main__":
    sys.exit(main())
