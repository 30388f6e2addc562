"""The acceptance of the fixed-lag smoother: ``python tools/streaming.py``."""
