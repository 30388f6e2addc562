"""The graph of the newest keyframes, and what was marginalised of it."""
