"""The acceptance of rough recordings: ``python tools/robustness.py``."""
