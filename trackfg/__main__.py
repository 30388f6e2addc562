"""``python -m trackfg``: the command line."""

from trackfg.cli.main import main

main()
