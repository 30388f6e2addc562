"""The batch smoother, from a recording to a result."""
