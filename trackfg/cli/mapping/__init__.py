"""The commands ``trackfg map``: the file of a map, the runs in it, and their tables."""
