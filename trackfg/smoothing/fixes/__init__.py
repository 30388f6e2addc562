"""Fixes of a run: those of balises, which of them are wrong, and the level of the others' errors."""
