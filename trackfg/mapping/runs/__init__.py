"""Runs over one line laid over each other: where each was on the first, and how well they repeat it."""
