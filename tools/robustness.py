"""Run :mod:`robustness.main`."""

from robustness.main import main

if __name__ == "__main__":
    main()
