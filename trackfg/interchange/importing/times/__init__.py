"""Times of a source become seconds on one clock."""
