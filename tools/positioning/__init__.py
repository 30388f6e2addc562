"""The benchmark of positioning: ``python tools/positioning.py``."""
