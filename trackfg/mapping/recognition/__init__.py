"""Where a run lies on a map."""
