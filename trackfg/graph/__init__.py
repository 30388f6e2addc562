"""The graph of a run: keyframes, factors and initial values."""
