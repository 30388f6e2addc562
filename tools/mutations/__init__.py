"""What the tests hold: ``python tools/mutations.py``."""
