"""Run :mod:`faults.main`."""

from faults.main import main

if __name__ == "__main__":
    main()
