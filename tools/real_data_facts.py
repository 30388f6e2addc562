"""Run :mod:`accuracy.real_data_facts`."""

import sys

from accuracy.real_data_facts import main

if __name__ == "__main__":
    sys.exit(main())
