"""``python -m trackfg``: the command line."""

from trackfg.cli import main

main()
