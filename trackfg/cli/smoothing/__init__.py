"""The command ``trackfg smooth``: its options, and the known line that a run is on."""
