"""Run :mod:`speed.map_storage`."""

import sys

from speed.map_storage import main

if __name__ == "__main__":
    sys.exit(main())
